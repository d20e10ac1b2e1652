"""Receipt of what robots say about their components: declarations, values and events.

A declaration is read in a thread, because a robot may declare thousands of members. Values that were missed are asked
for.
"""

import asyncio
import logging
from collections.abc import Coroutine, Iterable
from dataclasses import dataclass, field
from functools import cached_property

from linked_fleet_agent.wire.codec import WireError, decode
from linked_fleet_agent.wire.components import (
    Occurrence,
    Values,
    read_declarations,
)
from linked_fleet_gateway.api import Core, Robot, RobotModel, cancel_tasks
from linked_fleet_gateway.extensions.components.hand_declaration import with_hand
from linked_fleet_gateway.extensions.components.part import ComponentPart, parts_from
from linked_fleet_gateway.extensions.components.plans import plan
from linked_fleet_gateway.extensions.components.state import Change, RobotState
from linked_fleet_gateway.extensions.components.things import with_things
from linked_fleet_gateway.serving import NoAnswer
from linked_fleet_state.answers import DescriptionAndComponents

_log = logging.getLogger(__name__)

MAX_REPLY_BYTES = 320 * 1024
_ANSWER_S = 2.0
_ASK_AGAIN_S = 1.0
_NOTHING = b"[]"


@dataclass
class _Known:
    """The known components of a robot, and the description that they are from."""

    source: tuple[bytes, RobotModel | None, tuple[str, ...]]
    state: RobotState
    parts: dict[str, ComponentPart]
    """By name."""
    charges: list[int | None] = field(default_factory=list)

    @cached_property
    def batteries(self) -> list[ComponentPart]:
        return [each for each in self.parts.values() if each.is_battery]

    def paths(self, component: str, item: str) -> tuple[str, ...]:
        """Return the paths of a component and of an item of it that has changed, if any."""
        part = self.parts[component]
        return (part.path, part.path_of(item)) if item else (part.path,)


class Receipt:
    """Receives what robots say about their components, and keeps their parts up to date."""

    def __init__(self, core: Core) -> None:
        self._core = core
        self._known: dict[str, _Known] = {}
        self._asking = set[str]()
        self._tasks = set[asyncio.Task[None]]()
        core.hear_components("values", self._hear_values)
        core.hear_components("event", self._hear_event)

    async def close(self) -> None:
        await cancel_tasks(self._tasks)

    def forget(self, robot: str) -> None:
        """Forget a robot that was removed."""
        self._known.pop(robot, None)

    def _start(self, work: Coroutine[None, None, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._ended)

    def _ended(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            _log.error("components of a robot could not be read", exc_info=error)

    # -- declarations -----------------------------------------------------------------------------------------------

    def describe(self, name: str) -> None:
        """Read the declarations of a robot that has described itself."""
        robot = self._core.robots.get(name)
        if robot is None or robot.description is None or robot.model is None or robot.incarnation is None:
            return
        said = robot.description
        declared = said.components if isinstance(said, DescriptionAndComponents) else _NOTHING
        source = declared, robot.model, said.joints
        known = self._known.get(name)
        if known is not None and known.source == source:
            if known.state.incarnation != robot.incarnation:
                known.state.restart(robot.incarnation)
            known.state.complete = False  # messages may have been missed while it was away
            self._ask_soon(name)
        elif declared != _NOTHING or robot.parts:
            self._start(self._read(robot, source))

    async def _read(self, robot: Robot, source: tuple[bytes, RobotModel | None, tuple[str, ...]]) -> None:
        declared, model, _ = source
        assert model is not None
        components, refused = await asyncio.to_thread(read_declarations, declared, model.links, model.joints)
        if robot.model is not model or robot.incarnation is None:
            return  # it has described itself anew meanwhile
        added = (each.component_things for each in self._core.extensions)
        components = with_things(with_hand(components, model), added)
        state = RobotState(components, robot.incarnation)
        parts = parts_from(robot, model, components, state, plan)
        self._known[robot.name] = _Known(source, state, {each.name: each for each in parts.values()})
        for sentence in refused:
            self._core.reject(robot.name, sentence)
        self._core.set_parts(robot.name, parts, refused)
        self._ask_soon(robot.name)

    # -- values and events --------------------------------------------------------------------------------------------

    def _hear_values(self, name: str, payload: bytes) -> None:
        said = decode(payload, Values)
        if (known := self._known.get(name)) is None:
            return
        self._tell(name, known, *known.state.hear(said))
        if not known.state.complete:
            self._ask_soon(name)

    def _hear_event(self, name: str, payload: bytes) -> None:
        said = decode(payload, Occurrence)
        if (known := self._known.get(name)) is not None and (change := known.state.happen(said)) is not None:
            self._tell(name, known, [change], ())

    def _tell(self, name: str, known: _Known, changes: Iterable[Change], refused: Iterable[str]) -> None:
        for sentence in refused:
            self._core.reject(name, sentence)
        if paths := dict.fromkeys(path for change in changes for path in known.paths(*change)):
            self._core.mark_values_changed(name, *paths)
            self._look_at_batteries(known)

    def _look_at_batteries(self, known: _Known) -> None:
        """Tell the watchers of the fleet, which lists charges in whole per cent, of another one."""
        charges = [part.battery_percent for part in known.batteries]
        shown = [None if charge is None else int(charge) for charge in charges]
        if shown != known.charges:
            known.charges = shown
            self._core.mark_changed("/")

    def _ask_soon(self, name: str) -> None:
        known = self._known[name]
        if known.state.components and not known.state.complete and name not in self._asking:
            self._asking.add(name)
            self._start(self._ask(name))

    async def _ask(self, name: str) -> None:
        """Ask a robot for all values until they are complete, or nobody answers any more."""
        try:
            while (known := self._known.get(name)) is not None and not known.state.complete and self._is_there(name):
                try:
                    said = await self._core.live.link.ask_agent(
                        name, "values", None, MAX_REPLY_BYTES, _ANSWER_S, _read_values, "nobody answered"
                    )
                except NoAnswer as error:
                    _log.info("robot %s: its values could not be asked for: %s", name, error)
                    await asyncio.sleep(_ASK_AGAIN_S)
                    continue
                self._tell(name, known, *known.state.hear_all(said))
                if not known.state.complete:
                    await asyncio.sleep(_ASK_AGAIN_S / 10)
        finally:
            self._asking.discard(name)

    def _is_there(self, name: str) -> bool:
        robot = self._core.robots.get(name)
        return robot is not None and robot.online and robot.incarnation == self._known[name].state.incarnation

    # -- time ---------------------------------------------------------------------------------------------------------

    def expire(self) -> None:
        """Make the values unknown of components of which nothing was heard for too long, while their robot sends."""
        for name, known in self._known.items():
            robot = self._core.robots.get(name)
            if not known.parts or robot is None or not robot.online or (frame := robot.frame) is None:
                continue
            if frame.incarnation == known.state.incarnation:
                self._tell(name, known, list(known.state.expire(frame.monotonic_ns)), ())


def _read_values(answer: bytes | str) -> tuple[Values | None, str]:
    if isinstance(answer, str):
        return None, answer
    try:
        return decode(answer, Values), ""
    except WireError as error:
        return None, str(error)
