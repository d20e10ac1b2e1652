"""Which objects grippers hold: a grasp that succeeds takes the object that it names, and its gripper lets it go again.

It lets go when an ``open`` is accepted, when it says that it has lost what it held, or that it holds nothing any more.
The object then stays where it is at that moment. Each gateway hears of all that, and the first one that has written it
wins. What is not written yet, because Redis is away, is written as soon as it is back; motions wait for it.
"""

import asyncio
import logging
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

import msgspec
from msgspec.structs import replace
from pyoxigraph import NamedNode, RdfFormat, parse

from linked_fleet_base.errors import FleetError
from linked_fleet_gateway.api import Invocation, InvocationState, Pose, RedisUnavailable, Robot, Table, cancel_tasks
from linked_fleet_gateway.extensions.world.collisions import Unchecked
from linked_fleet_gateway.extensions.world.descriptions import OBJECTS
from linked_fleet_gateway.extensions.world.hands import grippers
from linked_fleet_gateway.extensions.world.held import FARTHEST_M, gap_m, held_by, in_hand, pose_of
from linked_fleet_gateway.extensions.world.placement import LF
from linked_fleet_gateway.extensions.world.scene import Held, SceneObject
from linked_fleet_gateway.faces import robot_path
from linked_fleet_gateway.serving import Live
from linked_fleet_state.gripper import Gripper

_log = logging.getLogger(__name__)
_AGAIN_S, _WAIT_S = 0.5, 2.0

Change = Callable[[SceneObject], SceneObject | None]
"""Returns what becomes of an object; None if nothing does."""


class _Grasped(msgspec.Struct):
    """The part of the result of a grasp that says if something is held."""

    holding: bool = False


class Holding:
    """Follows the grippers of all robots, and writes into ``objects`` what they hold; an async context manager."""

    def __init__(self, live: Live, objects: Table[SceneObject]) -> None:
        self._live, self._objects = live, objects
        self._due: dict[str, Change] = {}
        self._settled = asyncio.Event()
        self._settled.set()
        self._tasks: list[asyncio.Task[None]] = []

    async def __aenter__(self) -> Self:
        self._live.add_invocation_listener(self.hear_invocation)
        self._live.add_value_listener(self.hear_robot)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._live.remove_value_listener(self.hear_robot)
        self._live.remove_invocation_listener(self.hear_invocation)
        await cancel_tasks(self._tasks)

    async def wait_until_settled(self) -> None:
        """Wait until what grippers have done is written. Raises Unchecked if that takes too long."""
        try:
            async with asyncio.timeout(_WAIT_S):
                await self._settled.wait()
        except TimeoutError as error:
            raise Unchecked("What robots hold could not be written yet; try again.") from error

    # -- what is heard ----------------------------------------------------------------------------------------------

    def hear_invocation(self, invocation: Invocation) -> None:
        """Hear of an action, at whichever gateway, which may be one of a gripper that is long over."""
        thing, _, action = invocation.action.rpartition("/actions/")
        robot = self._live.fleet.robots.get(invocation.robot)
        if action not in ("grasp", "open") or robot is None:
            return
        segment = thing.removeprefix(robot_path(robot.name))
        if (gripper := grippers(robot).get(segment)) is None:
            return
        if action == "open" and invocation.accepted:
            for id, each in self._held_by(robot, segment).items():
                self._let_go(id, each, invocation.created_ns)
        elif action == "grasp" and invocation.state is InvocationState.SUCCEEDED:
            self._grasped(robot, segment, gripper, invocation)

    def hear_robot(self, name: str) -> None:
        """Let go of what a gripper says it does not hold any more."""
        robot = self._live.fleet.robots.get(name)
        if robot is None or not (held := held_by(robot, self._objects.known)):
            return
        known = grippers(robot)
        for id, thing in held.items():
            assert thing.held is not None
            if (gripper := known.get(thing.held.gripper)) is not None and _has_lost(gripper, thing.held):
                self._let_go(id, thing, time.time_ns())

    def _held_by(self, robot: Robot, segment: str) -> dict[str, SceneObject]:
        held = held_by(robot, self._objects.known)
        return {id: each for id, each in held.items() if each.held is not None and each.held.gripper == segment}

    # -- what becomes of objects ------------------------------------------------------------------------------------

    def _grasped(self, robot: Robot, segment: str, gripper: Gripper, invocation: Invocation) -> None:
        """Take the object that a grasp has named into the gripper, unless something later has been decided about it."""
        id = _named(invocation)
        thing = self._objects.known.get(id)
        if thing is None or thing.kind == "zone" or id in self._due:
            return
        if thing.decided_ns >= invocation.created_ns:
            return  # something later has been decided about it
        if invocation.incarnation != robot.incarnation or not _says_holding(invocation):
            return
        held = in_hand(robot, gripper, segment, thing)
        if held is None or gap_m(held, thing.geometry) > FARTHEST_M:
            _log.warning("%s does not hold %s, which is not known to be in its hand", robot.name, thing.title)
            return
        held = replace(held, since_ns=invocation.ended_ns or time.time_ns())
        for other, each in self._held_by(robot, segment).items():
            if other != id:
                self._let_go(other, each, invocation.created_ns)
        self._change(id, _into(held, invocation.created_ns))

    def _let_go(self, id: str, thing: SceneObject, decided_ns: int) -> None:
        """Leave an object where it is now, unless it has been taken after that was decided."""
        pose = pose_of(thing, self._live.fleet.robots)
        if thing.decided_ns >= decided_ns or id in self._due:
            return
        if pose is None:
            _log.warning("%s is let go, but it is unknown where: write its position", thing.title)
        self._change(id, _out_of(thing.held, pose, decided_ns))

    def _change(self, id: str, change: Change) -> None:
        self._due[id] = change
        if self._settled.is_set():
            self._settled.clear()
            self._tasks = [asyncio.create_task(self._write(), name="write what robots hold")]

    async def _write(self) -> None:
        while self._due:
            id, change = next(iter(self._due.items()))
            present = self._objects.known.get(id)
            found = None if present is None else change(present)
            try:
                if found is None or await self._objects.change(id, found):
                    self._due = {other: each for other, each in self._due.items() if each is not change}
            except RedisUnavailable:
                await asyncio.sleep(_AGAIN_S)
            except FleetError as error:  # there is no room for it
                _log.error("what holds an object could not be written: %s", error.detail)
                del self._due[id]
        self._settled.set()


def _named(invocation: Invocation) -> str:
    """Return the id of the object that a grasp has named, empty for none."""
    said = parse(invocation.body, format=RdfFormat.N_TRIPLES)
    things = (each.object for each in said if each.predicate == LF.object)
    return "".join(each.value.rpartition(f"{OBJECTS}/")[2] for each in things if isinstance(each, NamedNode))


def _into(held: Held, decided_ns: int) -> Change:
    def change(present: SceneObject) -> SceneObject | None:
        newer = present.decided_ns < decided_ns
        return replace(present, held=held, decided_ns=decided_ns) if newer else None

    return change


def _out_of(held: Held | None, pose: Pose | None, decided_ns: int) -> Change:
    """Return the change of an object that is let go. At an unknown place it stays held, until somebody writes it."""

    def change(present: SceneObject) -> SceneObject | None:
        if present.held != held or held is None:
            return None
        if pose is None:
            return replace(present, held=replace(held, gripper=""), decided_ns=decided_ns)
        return replace(present, pose=pose, held=None, decided_ns=decided_ns)

    return change


def _has_lost(gripper: Gripper, held: Held) -> bool:
    empty = gripper.holding is False and gripper.holding_ns > held.since_ns
    return empty or gripper.lost_ns > held.since_ns


def _says_holding(invocation: Invocation) -> bool:
    """Return True if the result of a grasp says that something is held."""
    try:
        return msgspec.json.decode(invocation.outcome, type=_Grasped).holding
    except ValueError:  # a gripper of which no result is known
        return False
