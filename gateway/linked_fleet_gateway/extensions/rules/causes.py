"""Causes of firings: motions that rules started, the earlier state of their robots, and rules that trigger themselves.

Pure; times are wall nanoseconds. A rule caused a firing if the condition would not have started to hold had the joints
and motions moved by earlier firings of that rule kept their state of the last evaluation. This is determined by
evaluating the condition on the fleet in that hypothetical state (``HypotheticalRobot``), not by analysis of the query.
A rule that triggers itself is found by its latest firings.
"""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

from linked_fleet_gateway.extensions.query.messages import HypotheticalRobot, Measured
from linked_fleet_gateway.extensions.rules.rule import FiringState, RuleRecord
from linked_fleet_state.invocation import Invocation
from linked_fleet_state.invocations import Invocations
from linked_fleet_state.robot import Robot

SETTLING_S = 1.0
"""Time after its end in which a motion can still cause changes: joints settle, and the end itself is a change."""
KEPT_S = 120.0
"""Time for which ended motions are kept; longer than the interval of evaluations of a costly condition."""
MOST_MOTIONS = 1_000
MOST_QUESTIONS = 8
"""Most hypothetical evaluations at one instant; rules with the same motions share one."""

Look = Mapping[str, "RobotState"]


@dataclass(frozen=True)
class RobotState:
    """One robot at one moment: its joints, their targets, and copies of its requested motions, by id."""

    joints: Mapping[str, Measured]
    targets: Mapping[str, float]
    motions: Mapping[str, Invocation]


@dataclass
class CausedMotion:
    """A motion started by a firing; ``rules`` are the rule that fired and all rules that caused the firing."""

    robot: str
    joints: frozenset[str]
    rules: frozenset[str]
    before: RobotState
    over_s: float | None = None


@dataclass(frozen=True)
class Counterfactual:
    """A hypothetical fleet in which some motions had no effect since the last evaluation; ``rules`` caused them."""

    rules: frozenset[str]
    robots: tuple[HypotheticalRobot, ...]


class Causes:
    """The motions that may still cause changes. ``now_s`` is monotonic."""

    def __init__(self) -> None:
        self._motions: dict[str, CausedMotion] = {}

    def note_motion(self, motion: Invocation, robot: Robot, rules: Collection[str], before: RobotState) -> None:
        """Record the motion that a firing started, with the state of its robot before. Stops are no causes."""
        if motion.targets:
            joints = _moved(robot, motion.targets)
            self._motions[motion.id] = CausedMotion(motion.robot, joints, frozenset(rules), before)
        while len(self._motions) > MOST_MOTIONS:
            del self._motions[next(iter(self._motions))]

    def knows(self, motion: Invocation) -> bool:
        """Return True if a motion is recorded."""
        return motion.id in self._motions

    def restore(self, rules: Iterable[RuleRecord], robots: Mapping[str, Robot], invocations: Invocations) -> None:
        """Record the running motions that firings at another gateway started."""
        for known in rules:
            for firing in known.firings.values():
                motion = invocations.get(firing.invocation.rpartition("/")[2])
                if firing.state is FiringState.SUPPRESSED or motion is None or motion.state.terminal:
                    continue
                if motion.id not in self._motions and motion.robot in robots:
                    robot = robots[motion.robot]
                    self.note_motion(motion, robot, {known.rule.id, *firing.causes}, state_of(robot, invocations))

    def observe(self, robots: Mapping[str, Robot], invocations: Invocations, now_s: float) -> Look:
        """Return the present state of the robots of all motions that may still cause changes."""
        for id, caused in list(self._motions.items()):
            motion = invocations.get(id)
            if caused.over_s is None and (motion is None or motion.state.terminal):
                caused.over_s = now_s
            elif caused.over_s is not None and now_s - caused.over_s > KEPT_S:
                del self._motions[id]
        names = {each.robot for each in self._motions.values() if _lasts(each, now_s)}
        return {name: state_of(robots[name], invocations) for name in names if name in robots}

    def counterfactuals(self, rule: str, since_s: float, look: Look) -> list[Counterfactual]:
        """Return the hypothetical states that reveal the causes of a change since ``since_s``, given the state then.

        The motions caused by ``rule`` itself come first, then the most recent ones.
        """
        motions_of: dict[str, list[str]] = {rule: []}
        for id, caused in reversed(self._motions.items()):
            if _lasts(caused, since_s):
                for each in sorted(caused.rules):
                    motions_of.setdefault(each, []).append(id)
        rules_of: dict[frozenset[str], set[str]] = {}
        for each, ids in motions_of.items():
            if ids:
                rules_of.setdefault(frozenset(ids), set()).add(each)
        asked = list(rules_of.items())[:MOST_QUESTIONS]
        return [Counterfactual(frozenset(rules), self._without(ids, look)) for ids, rules in asked]

    def _without(self, ids: Collection[str], look: Look) -> tuple[HypotheticalRobot, ...]:
        found = []
        for name in dict.fromkeys(self._motions[id].robot for id in ids):
            of_robot = {id: each for id, each in self._motions.items() if id in ids and each.robot == name}
            # A robot that was not recorded then had none of these motions yet: it was in the state before the first of
            # them.
            state = look.get(name) or next(iter(of_robot.values())).before
            joints = frozenset().union(*(each.joints for each in of_robot.values()))
            found.append(
                HypotheticalRobot(
                    robot=name,
                    joints={joint: state.joints[joint] for joint in joints if joint in state.joints},
                    targets={joint: state.targets.get(joint) for joint in joints},
                    motions={id: state.motions.get(id) for id in of_robot},
                )
            )
        return tuple(found)


def begun_by(rules: Iterable[RuleRecord]) -> dict[str, frozenset[str]]:
    """Return the rules that have begun what may be no motion, by the ids of its invocations."""
    firings = ((known.rule.id, each) for known in rules for each in known.firings.values() if each.invocation)
    return {each.invocation.rpartition("/")[2]: frozenset({rule, *each.causes}) for rule, each in firings}


def state_of(robot: Robot, invocations: Invocations) -> RobotState:
    """Return copies, because a robot and its motions change."""
    frame, description = robot.frame, robot.description
    joints: dict[str, Measured] = {}
    if frame is not None and description is not None:
        rows = zip(frame.positions, frame.velocities, frame.efforts, strict=True)
        joints = dict(zip(description.joints, rows, strict=True))
    motions = {each.id: replace(each) for each in invocations.open_of_robot(robot.name)}
    return RobotState(joints, dict(robot.targets), motions)


def _moved(robot: Robot, targets: Collection[str]) -> frozenset[str]:
    """Return the commanded joints and those that mimic them."""
    moved = set(targets)
    if robot.model is not None:
        following = [each for each in robot.model.joints.values() if each.mimic is not None]
        for _ in following:  # mimic joints may form chains
            moved |= {each.name for each in following if each.mimic is not None and each.mimic.joint in moved}
    return frozenset(moved)


def _lasts(caused: CausedMotion, since_s: float) -> bool:
    return caused.over_s is None or caused.over_s + SETTLING_S >= since_s


FIRINGS, WITHIN_S = 6, 60
"""A rule whose own firings caused this many new firings within ``WITHIN_S`` seconds is disabled."""


def self_caused(known: RuleRecord, causes: Collection[str], at_ns: int) -> tuple[int, ...]:
    """Return the times within the last ``WITHIN_S`` at which its own firings made the rule start to hold.

    ``causes`` are the rules that caused it to hold at ``at_ns``. The latest firing of the same revision stores the
    earlier times; enabling a rule creates a new revision and so restarts the count.
    """
    claimed = [each for each in known.firings.values() if each.state is not FiringState.SUPPRESSED]
    before = claimed[-1].self_caused if claimed and claimed[-1].revision == known.revision else ()
    now = (at_ns,) if known.rule.id in causes else ()
    # Times ahead of the clock are from before it was set back.
    recent = [each for each in (*before, *now) if abs(at_ns - each) < WITHIN_S * 10**9]
    return tuple(recent[-FIRINGS:])


def reason_to_disable(known: RuleRecord, causes: Collection[str], times_ns: Collection[int]) -> str:
    """Return a sentence for people if the rule must be disabled, else an empty string."""
    if known.rule.id not in causes or len(times_ns) < FIRINGS:
        return ""
    others = sorted(each for each in causes if each != known.rule.id)
    through = f", through {', '.join(f'/rules/{id}' for id in others[:5])}" if others else ""
    return f"disabled because its own firings made it start to hold {FIRINGS} times within {WITHIN_S} s{through}"
