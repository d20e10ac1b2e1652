"""The extension ``latches``: stops that hold until a person resets them."""

import asyncio
import logging
import time
import uuid
from collections.abc import AsyncIterator, Collection, Mapping, Sequence
from contextlib import asynccontextmanager
from functools import lru_cache, partial
from pathlib import Path

from msgspec.structs import replace

from linked_fleet_base.errors import InsufficientScope, MotionRefused
from linked_fleet_gateway.api import (
    Conflict,
    Container,
    Core,
    Extension,
    FleetError,
    Invocation,
    Motion,
    Mount,
    Right,
    Robot,
    Table,
    gauge,
    timestamp,
)
from linked_fleet_gateway.extensions.latches.latch import (
    FLEET,
    Latch,
    describe_latch,
    nothing_there,
    read_latch,
)
from linked_fleet_gateway.extensions.latches.terms import LF
from linked_fleet_gateway.faces import Identity, Tree, View
from linked_fleet_state.unchecked import Finding

HERE = Path(__file__).parent
log = logging.getLogger(__name__)
SEGMENT = "stopLatches"
_MOST = 10_000
_FREE = Finding(free=True)


class StopLatched(MotionRefused):
    """A stop of the robot, or of the fleet, holds until a person resets it."""

    status, code, title = 409, "stop-latched", "A stop holds until it is reset"


class Latches:
    """The latches as the records of their container, of which a robot has one, and the fleet one.

    The id of a latch says of which robot it is. So one whose record cannot be read holds too, until it is reset.
    """

    def __init__(self, table: Table[Latch], robots: Collection[str]) -> None:
        self._table, self._robots = table, robots

    @property
    def known(self) -> Mapping[str, Latch]:
        """The latches by id."""
        if not (unreadable := self._table.unreadable):
            return self._table.known
        names = {_id_of(each): each for each in (FLEET, *self._robots)}
        return {**self._table.known, **{id: _unread(names[id]) for id in unreadable if id in names}}

    def of(self, robot: str) -> tuple[str, Latch] | None:
        """Return the latch that keeps a robot still, with its id; None if it may move."""
        for each in (FLEET, robot):
            id = _id_of(each)
            if (latch := self._table.known.get(id)) is not None:
                return id, latch
            if id in self._table.unreadable:
                return id, _unread(each)
        return None

    async def add(self, record: Latch) -> str:
        """Add a latch and return its id; that of the known one if it says as much.

        Raises Conflict, RedisUnavailable, ContainerFull.
        """
        id = _id_of(record.robot)  # of two at the same time one is there
        while (held := self._table.known.get(id)) is None:
            if await self._table.change(id, record):
                return id
        if record.reason in ("", held.reason):
            return id
        raise Conflict(f"The {record.title[0].lower()}{record.title[1:]} holds already: PUT /{SEGMENT}/{id}.")

    async def change(self, id: str, record: Latch | None) -> bool:
        """Replace the reason of a latch, or reset it for None. Return False if it has changed meanwhile.

        Raises Conflict for what would keep another robot still.
        """
        held = self.known.get(id)
        if record is not None and held is not None:
            if record.robot != held.robot:
                raise Conflict(f"This latch is about {held.path}. Post another one for {record.path}.")
            record = replace(record, by=held.by, since_ns=held.since_ns)
        return await self._table.change(id, record)


@lru_cache(maxsize=20_000)
def _id_of(robot: str) -> str:
    return str(uuid.uuid5(uuid.NAMESPACE_URL, Latch(robot).path))


def _unread(robot: str) -> Latch:
    """Return a latch of which nothing is known but its robot."""
    return Latch(robot, "its record cannot be read")


class _Guard:
    """Refuses the motions of robots whose stop holds, also those that are rehearsed."""

    finding_predicate = LF.notLatched

    def __init__(self, latches: Latches) -> None:
        self._latches = latches

    async def wait_until_ready(self, robot: Robot, visible_robots: View) -> None:
        """Return at once: a motion is checked after its request is known, so that a repeated one gets its answer."""

    async def check_path(self, motion: Motion, visible_robots: View, own_id: str) -> Finding:
        self._check(motion.robot)
        return _FREE

    def _check(self, robot: Robot) -> None:
        if (found := self._latches.of(robot.name)) is None:
            return
        id, latch = found
        what = robot.name if latch.robot else "the fleet"
        why = f" ({latch.reason})" if latch.reason else ""
        when = f" at {timestamp(latch.since_ns).value}" if latch.since_ns else ""
        detail = (
            f"{latch.by or 'Somebody'} stopped {what}{when}{why}, and the stop holds. "
            f"Who may reset it deletes /{SEGMENT}/{id}."
        )
        raise StopLatched(detail, reason=f"the stop of {what} holds")


class LatchesExtension(Extension):
    """Stops that hold, at ``/stopLatches``."""

    name = "latches"
    at_root = (SEGMENT,)
    guards_motions = True
    vocabulary = (HERE / "vocabulary.ttl",)
    shapes = (HERE / "shapes.ttl",)

    def views(self) -> Sequence[object]:
        from linked_fleet_gateway.extensions.latches import page

        return page.VIEWS

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        cancelling = set[asyncio.Task[None]]()
        table = core.table(SEGMENT, Latch, partial(_heard, core, cancelling), _MOST)
        table.on_unreadable = lambda id: core.mark_changed(f"/{SEGMENT}/{id}", f"/{SEGMENT}")
        async with table:
            latches = Latches(table, core.robots)
            yield Mount(
                branches=(_container(core.robots, latches).branch,),
                guard=_Guard(latches),
                services=(latches,),
                metrics=lambda: [
                    gauge("stop_latches", "Stops that hold until somebody resets them.", len(latches.known))
                ],
            )


def _heard(core: Core, cancelling: set[asyncio.Task[None]], id: str, before: Latch | None, after: Latch | None) -> None:
    """Tell the subscribers of a latch and of all latches, and cancel what began before this gateway knew of it."""
    core.mark_changed(f"/{SEGMENT}/{id}", f"/{SEGMENT}")
    if before is not None or after is None:
        return
    core.live.fan_out.add_resource(f"/{SEGMENT}/{id}")
    for each in _begun_since(core, after):
        task = asyncio.create_task(_cancel(core, each, f"the {after.title} holds"), name=f"cancel {each.id}")
        cancelling.add(task)
        task.add_done_callback(cancelling.discard)


def _begun_since(core: Core, latch: Latch) -> list[Invocation]:
    known = core.live.invocations
    robots = [latch.robot] if latch.robot else known.robots_with_open()
    open_ = [each for robot in robots for each in known.open_of_robot(robot)]
    return [each for each in open_ if each.is_motion and each.created_ns >= latch.since_ns]


async def _cancel(core: Core, invocation: Invocation, reason: str) -> None:
    try:
        await core.cancel(invocation.id, reason)
    except FleetError as error:
        log.warning("%s was not cancelled although a stop holds: %s", invocation.id, error.detail)


def _container(robots: Mapping[str, Robot], records: Latches) -> Container[Latch]:
    return Container(
        segment=SEGMENT, title="Stops that hold", type=LF.StopLatchList, member_type=LF.StopLatch, records=records,
        shape=LF.StopLatchInput, read=partial(read_latch, robots), describe=describe_latch,
        title_of=lambda latch: latch.title, predicate=LF.stopLatches, member_blueprint=LF.StopLatchShape,
        writing=(Right.STOP, Right.RESET), check=_check, owned=_may_reset, signed=_signed, visible=_is_visible,
    )  # fmt: skip


async def _check(latch: Latch, tree: Tree, caller: Identity) -> None:
    """Raise UnprocessableContent for a hidden robot or another gateway; InsufficientScope without the right to stop."""
    if latch.base != tree.view.base or not _is_visible(latch, tree.view.visible_robots):
        raise nothing_there(latch.base + latch.path)
    if not _has_right(caller, Right.STOP, latch):
        raise InsufficientScope(f"The {latch.title} takes the right to stop there.", scope=Right.STOP)


def _is_visible(latch: Latch, sees: View) -> bool:
    return latch.robot == FLEET or sees.includes(latch.robot)


def _may_reset(latch: Latch, caller: Identity, client: str) -> bool:
    return _has_right(caller, Right.RESET, latch)


def _has_right(caller: Identity, right: Right, latch: Latch) -> bool:
    """Return True for somebody with the right on the robot or, for a latch of the fleet, on all robots."""
    return caller.has_right(right, latch.robot) if latch.robot else caller.view_for(right).includes_all


def _signed(latch: Latch, caller: Identity, client: str) -> Latch:
    return replace(latch, base="", by=caller.name or client, since_ns=time.time_ns())
