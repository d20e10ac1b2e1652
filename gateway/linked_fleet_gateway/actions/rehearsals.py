"""Rehearsals: what an action would do now, or after other actions, while nothing moves."""

import math
import time
import uuid
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field, replace

from pyoxigraph import Literal, NamedNode

from linked_fleet_agent.wire.messages import WIRE_VERSION, Accepted, Follow, Move, Refused, Stop
from linked_fleet_base.errors import AgentTimeout, Changed, Conflict
from linked_fleet_gateway.actions.guards import Guards, limited, unchecked
from linked_fleet_gateway.actions.lifecycle import Lifecycle
from linked_fleet_gateway.actions.opening import Opening
from linked_fleet_gateway.actions.operations import Operation, describe_nothing
from linked_fleet_gateway.actions.plan import Act, Caller, Halt, Motion, build_command
from linked_fleet_gateway.actions.refusals import StallDetector, agent_refusal, required_lease_id
from linked_fleet_gateway.actions.stop_delivery import ANSWER_TIMEOUT_S
from linked_fleet_gateway.resources.action_offer import Offer
from linked_fleet_gateway.resources.invocation import describe_path
from linked_fleet_gateway.subscriptions.live import Live
from linked_fleet_identity.rights import View
from linked_fleet_link.fleet_link import NoAnswer
from linked_fleet_rdf.graph import Graph, Node
from linked_fleet_rdf.vocabulary import LF
from linked_fleet_state.closest import Closest
from linked_fleet_state.invocations import FLEET
from linked_fleet_state.kept_plan import KeptPlan
from linked_fleet_state.pace import duration_s
from linked_fleet_state.robot import Robot
from linked_fleet_state.unchecked import UncheckedLink


@dataclass(frozen=True)
class Rehearsal:
    """The result of a rehearsal: duration, and ids of the invocations that it would end.

    ``findings``: whether each guard found the path free, by its predicate. ``unchecked``: the links that the guards
    did not cover, each after its path. ``facts`` are further values, by name (SI). ``limited`` says why the guards
    reduce its speed. ``path`` is the one that was planned, and ``detour`` why it is not the direct one. ``closest`` is
    where guards found it closest to something. ``plan`` is the one that is kept for a request of this very motion.
    ``things`` are what the findings depend on, each a predicate and a path. ``after`` is its robot as it would stand
    then; None if that is not known. ``describe`` adds further statements about the node of the rehearsal.
    """

    duration_s: float
    preempts: tuple[str, ...]
    findings: Mapping[NamedNode, bool] = field(default_factory=dict)
    unchecked: tuple[tuple[str, UncheckedLink], ...] = ()
    facts: Mapping[str, float] = field(default_factory=dict)
    limited: str = ""
    path: Follow | None = None
    detour: str = ""
    closest: tuple[Closest, ...] = ()
    plan: KeptPlan | None = None
    things: tuple[tuple[NamedNode, str], ...] = ()
    after: Robot | None = None
    describe: Callable[[Graph, Node], None] = describe_nothing

    def describe_path(self, graph: Graph, node: Node, base: str, most: int) -> None:
        """Add a path that was planned, with at most so many waypoints, and why it is not the direct one."""
        if self.path is None or self.after is None:
            return
        graph.add(node, LF.plannedBecause, Literal(self.detour))
        describe_path(graph, node, base, self.after, self.path, most)


class Rehearsals:
    """Rehearses plans. ``ready`` waits for the guards of a motion, and returns the time that this took, in ns."""

    def __init__(
        self,
        live: Live,
        guards: Guards,
        lifecycle: Lifecycle,
        opening: Opening,
        stalls: StallDetector,
        ready: Callable[[Motion, Caller], Awaitable[int]],
    ) -> None:
        self._live, self._guards, self._lifecycle = live, guards, lifecycle
        self._opening, self._stalls, self._ready = opening, stalls, ready

    async def of(self, offer: Offer, plan: Motion | Halt | Operation, caller: Caller) -> Rehearsal:
        """Return the effect that carrying out a plan would have. Raises the same errors."""
        if isinstance(plan, Motion):
            return await self._motion(plan, caller)
        if isinstance(plan, Halt):
            return await self._halt(plan, caller.stoppable_robots)
        if not offer.is_stop:
            await self._opening.check(FLEET if offer.robot is None else offer.robot.name, caller)
        took_s, describe = await plan.rehearsed(caller)
        return Rehearsal(took_s, (), describe=describe)

    async def _motion(self, motion: Motion, caller: Caller) -> Rehearsal:
        robot, waited_ns = motion.robot, await self._ready(motion, caller)
        if motion.moves:
            self._lifecycle.stops.check_motion(robot.name)
        await self._opening.check(robot.name, caller, required_lease_id(robot) if motion.tied_to_lease else "")
        began_ns, paths = time.monotonic_ns(), self._guards.paths(motion, caller, "")
        motion, findings = await self._guards.on_free_path(motion, caller, "", paths)
        waited_ns += self._stalls.elapsed_ns(began_ns)
        motion, why = limited(motion, findings)
        path = motion.motion if motion.detour else None
        assert not isinstance(path, Move | Act)  # a planned path has waypoints
        found = Rehearsal(
            0.0,
            (),
            {predicate: finding.free for predicate, finding in findings.items()},
            unchecked(findings),
            dict(motion.facts),
            why,
            path,
            motion.detour,
            tuple(each.closest for each in findings.values() if each.closest is not None),
            things=tuple(each for finding in findings.values() for each in finding.things),
            after=_after(motion),
        )
        if robot.name in motion.assumed and not isinstance(motion.motion, Act):
            return replace(found, duration_s=_duration_s(motion, motion.motion))
        reply = await self._ask(motion, waited_ns)
        kept = None if paths is None else await paths.keep(motion)
        return replace(found, duration_s=reply.duration_s, preempts=reply.preempts, plan=kept)

    async def _ask(self, motion: Motion, waited_ns: int) -> Accepted:
        """Return what the agent says of a motion. Raises Conflict, AgentTimeout."""
        try:
            command = build_command(str(uuid.uuid4()), motion, waited_ns, rehearsal=True)
            reply = await self._live.link.command(motion.robot.name, command, ANSWER_TIMEOUT_S)
        except NoAnswer as error:
            raise AgentTimeout(f"The agent of {motion.robot.name} gave no answer: {error}.") from error
        if isinstance(reply, Refused):
            raise agent_refusal(motion.robot, reply)
        return reply

    async def _halt(self, halt: Halt, stoppable_robots: View) -> Rehearsal:
        """Return the invocations that a stop would end."""
        stop = Stop(version=WIRE_VERSION, id=str(uuid.uuid4()), joints=halt.joints, rehearsal=True)
        robots = self._lifecycle.stops.reached(halt.robots, stoppable_robots)
        replies = await self._live.link.stop(robots, stop, ANSWER_TIMEOUT_S)
        accepted = [reply for reply in replies.values() if isinstance(reply, Accepted)]
        if halt.robots is not None and not accepted:
            raise AgentTimeout(f"The agent of {halt.robots[0]} gave no answer.")
        ends = tuple(id for reply in accepted for id in reply.preempts)
        return Rehearsal(max((reply.duration_s for reply in accepted), default=0.0), ends)


def _after(motion: Motion) -> Robot | None:
    """Return the robot as it would stand after a motion; None if that is not known."""
    if isinstance(motion.motion, Act):
        return None if motion.moves else motion.robot
    return motion.robot.standing_at(motion.targets)


def _duration_s(motion: Motion, moved: Move | Follow) -> float:
    """Return how long a motion from where its robot would stand takes. Its agent only knows where it stands now.

    Raises Changed, Conflict.
    """
    robot, places = motion.robot, motion.robot.positions
    for name, expected in motion.expectations.items():
        if not abs(places.get(name, math.nan) - expected.position) <= expected.tolerance:
            raise Changed(f"The precondition does not hold: {name} would be at {places.get(name, math.nan):.6g}.")
    if unknown := [name for name in motion.targets if math.isnan(places.get(name, math.nan))]:
        raise Conflict(f"The position of {unknown[0]} of {robot.name} is unknown at present.")
    return duration_s(robot, moved, motion.speed_scale, places)
