"""Guards check the path of a planned motion before its robot gets it; a planner finds other paths."""

from collections.abc import Mapping
from contextlib import suppress
from typing import Protocol

from pyoxigraph import NamedNode

from linked_fleet_base.errors import Busy, MotionRefused, NotReadYet
from linked_fleet_gateway.actions.plan import Caller, Motion, slowed
from linked_fleet_identity.rights import View
from linked_fleet_runtime.replica import Copies
from linked_fleet_state.kept_plan import KeptPlan
from linked_fleet_state.robot import Robot
from linked_fleet_state.unchecked import Finding, UncheckedLink


class MotionGuard(Protocol):
    """Checks motions for collisions and similar; ``visible_robots`` limits what its errors may reveal.

    An action of a component is a motion too if it moves something; its path is known only if it has a ``drive``.
    """

    finding_predicate: NamedNode
    """Predicate of rehearsals: true if the path was found free, ``lf:unknown`` if it could not be checked."""

    async def wait_until_ready(self, robot: Robot, visible_robots: View) -> None:
        """Wait until motions of a robot can be checked. Raises MotionRefused if that takes too long."""

    async def check_path(self, motion: Motion, visible_robots: View, own_id: str) -> Finding:
        """Check the path of a motion. A finding is not free if the robot has no placement. Raises MotionRefused.

        One about a drive may reduce its speed. Other running motions are considered, except the invocation with the id
        ``own_id``.
        """


class Paths(Protocol):
    """The paths that a motion may take, one after the other."""

    most_s: float
    """Bound of the time that all of ``next`` take together, in seconds."""

    async def next(self, refused: MotionRefused | None) -> Motion | None:
        """Return the motion on its first path, or on another one after the guards have ``refused`` the last.

        It is None if there is no other one. Raises MotionRefused, Conflict, UnprocessableContent, Busy.
        """

    async def keep(self, motion: Motion) -> KeptPlan | None:
        """Keep a rehearsed motion, so that another request can have the very same one; None if it is not kept."""


class MotionPlanner(Protocol):
    """Finds the paths of motions."""

    def paths(self, motion: Motion, caller: Caller, own_id: str) -> Paths | None:
        """Return the paths of a motion; None if it takes the direct one only.

        ``own_id`` is its invocation, empty for a rehearsal. Raises FleetError.
        """

    def advise(self, motion: Motion, refused: MotionRefused) -> None:
        """Add to the refusal of a motion that takes the direct path what would let it take another one."""


class Guards:
    """The guards of a gateway, and the planner of paths if it has one.

    Without one of the copies that they need they refuse every motion.
    """

    def __init__(self, copies: Copies) -> None:
        self._copies = copies
        self._guards: list[MotionGuard] = []
        self.planner: MotionPlanner | None = None

    def add(self, guard: MotionGuard) -> None:
        """Add a guard, which checks every motion before it is accepted."""
        self._guards.append(guard)

    async def await_ready(self, robot: Robot, visible_robots: View) -> None:
        """Wait until motions of a robot can be checked, or until the guards give up waiting."""
        for guard in self._guards:
            with suppress(MotionRefused, Busy):
                await guard.wait_until_ready(robot, visible_robots)

    async def wait_until_ready(self, robot: Robot, visible_robots: View) -> None:
        """Wait until motions of a robot can be checked. Raises MotionRefused, Busy."""
        self._check_copies()
        for guard in self._guards:
            await guard.wait_until_ready(robot, visible_robots)

    def paths(self, motion: Motion, caller: Caller, own: str) -> Paths | None:
        """Return the paths that a motion may take; None for the direct one only. Raises FleetError."""
        return None if self.planner is None or not motion.moves else self.planner.paths(motion, caller, own)

    async def on_free_path(
        self, motion: Motion, caller: Caller, own: str, paths: Paths | None
    ) -> tuple[Motion, dict[NamedNode, Finding]]:
        """Return a motion on the first of its paths that the guards do not refuse, and their findings.

        Raises MotionRefused, and what its planner raises.
        """
        if paths is None:
            return motion, await self._on_direct_path(motion, caller, own)
        refused: MotionRefused | None = None
        while (planned := await paths.next(refused)) is not None:
            try:
                return planned, await self.findings(planned, caller, own)
            except MotionRefused as error:
                refused = error
        assert refused is not None
        raise refused

    async def _on_direct_path(self, motion: Motion, caller: Caller, own: str) -> dict[NamedNode, Finding]:
        """Return the findings of the guards. What they raise says if there may be another path."""
        try:
            return await self.findings(motion, caller, own)
        except MotionRefused as error:
            if self.planner is not None:
                self.planner.advise(motion, error)
            raise

    async def findings(self, motion: Motion, caller: Caller, own: str) -> dict[NamedNode, Finding]:
        """Return the finding of each guard about what moves. Raises MotionRefused."""
        if motion.moves:
            self._check_copies()
        return {
            guard.finding_predicate: await guard.check_path(motion, caller.visible_robots, own)
            for guard in self._guards
            if motion.moves
        }

    def _check_copies(self) -> None:
        if missed := self._copies.missed_by_motions():
            raise NotReadYet(f"This gateway has not read yet what motions are judged by: {missed}. Ask again.")


def limited(motion: Motion, findings: Mapping[NamedNode, Finding]) -> tuple[Motion, str]:
    """Return the motion at the speed that all findings allow, and why it is slower, if it is."""
    slowest = min(findings.values(), key=lambda each: each.speed_share, default=None)
    if slowest is None or slowest.speed_share >= 1.0:
        return motion, ""
    return slowed(motion, slowest.speed_share), slowest.limited


def unchecked(findings: Mapping[NamedNode, Finding]) -> tuple[tuple[str, UncheckedLink], ...]:
    return tuple(each for finding in findings.values() for each in finding.unchecked)
