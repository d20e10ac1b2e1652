"""Which rules caused a condition to hold, on a simulated fleet and clock."""

import itertools

from linked_fleet_gateway.extensions.query.messages import HypotheticalRobot
from linked_fleet_gateway.extensions.rules.causes import KEPT_S, SETTLING_S, Causes, Counterfactual, Look, state_of
from linked_fleet_gateway.extensions.rules.rule import Firing, FiringState, Rule, RuleRecord
from linked_fleet_state.invocation import Invocation, InvocationState
from mirrored_fleet import MirroredFleet

IDS = map(str, itertools.count())


class Scene:
    """Two robots, ``a`` and ``b``, which stand; motions begin and end when the test says so."""

    def __init__(self) -> None:
        self.fleet, self.causes = MirroredFleet(), Causes()
        for name in ("a", "b"):
            self.fleet.describe(name)
            self.fleet.stand(name, (0.0, 0.0))

    def fire(self, rule: str, *because: str, robot: str = "a", joint: str = "elbow") -> Invocation:
        motion, there = self.motion(robot, joint), self.fleet.fleet.robots[robot]
        before = state_of(there, self.fleet.invocations)
        self.fleet.invocations.add(motion)
        self.causes.note_motion(motion, there, {rule, *because}, before)
        return motion

    def motion(self, robot: str = "a", joint: str = "elbow") -> Invocation:
        return Invocation(next(IDS), robot, f"/{robot}/{joint}/actions/rotate", {joint: 1.0}, 1, 2)

    def look(self, now_s: float) -> Look:
        return self.causes.observe(self.fleet.fleet.robots, self.fleet.invocations, now_s)

    def questions(self, rule: str, since_s: float, look: Look) -> list[set[str]]:
        return [set(each.rules) for each in self.causes.counterfactuals(rule, since_s, look)]

    def question(self, rule: str, since_s: float, look: Look) -> HypotheticalRobot:
        (found,) = self.causes.counterfactuals(rule, since_s, look)
        assert isinstance(found, Counterfactual)
        (instead,) = found.robots
        return instead


def test_a_motion_is_a_cause_until_a_moment_after_its_end() -> None:
    scene = Scene()
    motion = scene.fire("one")
    assert scene.questions("other", 10.0, scene.look(10.0)) == [{"one"}]
    motion.state = InvocationState.SUCCEEDED
    look = scene.look(20.0)
    assert set(look) == {"a"}
    assert scene.questions("other", 20.0 + SETTLING_S, look) == [{"one"}]
    assert scene.questions("other", 20.1 + SETTLING_S, look) == []
    assert scene.look(20.1 + SETTLING_S) == {}


def test_motions_that_are_over_are_forgotten() -> None:
    scene = Scene()
    scene.fire("one").state = InvocationState.SUCCEEDED
    scene.look(0.0)
    scene.look(KEPT_S + 1.0)
    assert scene.questions("other", 0.0, {}) == []


def test_all_rules_of_a_chain_are_asked_about() -> None:
    scene = Scene()
    scene.fire("one")
    look = scene.look(1.0)
    assert scene.questions("one", 1.0, look) == [{"one"}]
    scene.fire("two", "one", robot="b")
    assert scene.questions("one", 1.0, look) == [{"one"}, {"two"}]
    scene.fire("three", "one", "two", robot="b")
    assert sorted(map(sorted, scene.questions("four", 1.0, look))) == [["one"], ["three"], ["two"]]


def test_rules_with_the_same_motions_are_asked_about_at_once() -> None:
    scene = Scene()
    scene.fire("two", "one")
    assert scene.questions("one", 1.0, scene.look(1.0)) == [{"one", "two"}]


def test_joints_targets_and_motions_are_as_they_were_at_the_last_look_and_those_of_others_as_they_are() -> None:
    scene = Scene()
    motion = scene.fire("one")
    scene.fleet.stand("a", (0.5, 0.0))
    scene.fleet.fleet.robots["a"].targets["elbow"] = 1.0
    look = scene.look(1.0)
    scene.fleet.stand("a", (0.9, 0.1))
    motion.state = InvocationState.SUCCEEDED
    scene.fleet.fleet.robots["a"].targets.clear()
    instead = scene.question("one", 1.0, look)
    assert {name: values[0] for name, values in instead.joints.items()} == {"elbow": 0.5}
    assert instead.targets == {"elbow": 1.0}
    then = instead.motions[motion.id]
    assert then is not None and then.state is InvocationState.ACCEPTED


def test_a_motion_that_began_after_the_last_look_was_not_there_then() -> None:
    scene = Scene()
    look = scene.look(1.0)
    motion = scene.fire("one")
    scene.fleet.stand("a", (0.9, 0.1))
    instead = scene.question("one", 1.0, look)
    assert instead.joints["elbow"][0] == 0.0
    assert instead.motions == {motion.id: None}


def test_stopping_moves_nothing_and_is_no_cause() -> None:
    scene = Scene()
    robot = scene.fleet.fleet.robots["a"]
    stop = Invocation(next(IDS), "a", "/a/actions/stop", {}, 1, 2, stops=())
    scene.causes.note_motion(stop, robot, {"one"}, state_of(robot, scene.fleet.invocations))
    assert scene.look(1.0) == {}


def test_another_gateway_takes_over_the_motions_that_are_under_way() -> None:
    scene = Scene()
    under_way, over = scene.motion(), scene.motion()
    over.state = InvocationState.SUCCEEDED
    known = RuleRecord(Rule("one", "a rule", "", "/a/actions/stop", "http://fleet", "", 0), 1)
    for number, motion in enumerate((under_way, over)):
        scene.fleet.invocations.add(motion)
        path = f"{motion.action}/invocations/{motion.id}"
        known.firings[number] = Firing(1, {}, FiringState.ACCEPTED, invocation=path, causes=("two",))
    scene.causes.restore([known], scene.fleet.fleet.robots, scene.fleet.invocations)
    assert scene.questions("one", 1.0, scene.look(1.0)) == [{"one", "two"}]
    assert list(scene.question("one", 1.0, scene.look(1.0)).motions) == [under_way.id]
