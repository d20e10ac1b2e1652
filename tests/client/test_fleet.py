"""The client with the real fleet."""

import math
from collections.abc import Iterator

import pytest

from linked_fleet_client.errors import InvalidInput, Problem
from linked_fleet_client.fleet import Fleet, Thing
from linked_fleet_client.invocation import Invocation
from linked_fleet_client.quantity import Quantity
from linked_fleet_client.vocabulary import LF
from running import eventually
from shared_fixtures import RunningFleet

pytestmark = pytest.mark.virtual


@pytest.fixture
def here(fleet: RunningFleet) -> Iterator[Fleet]:
    with Fleet(fleet.root) as here:
        yield here


@pytest.fixture
def joint(here: Fleet) -> Thing:
    return here["baxter"]["right_s1"]


def angle(joint: Thing) -> float:
    number = joint.properties["rotation"].value.to("deg").number
    assert number is not None
    return number


def test_robots_joints_and_values_are_found(here: Fleet, joint: Thing) -> None:
    assert [robot.name for robot in here] == ["baxter", "go2", "panda", "tiago", "ur5"]
    assert {robot.presence for robot in here} == {"online"}
    value = joint.properties["rotation"].value
    assert (value.unit_label, value.number is not None, value.time is not None) == ("rad", True, True)
    limits = joint.properties["limits"].reading.values
    assert {"lowerLimit", "upperLimit", "velocityLimit", "effortLimit"} <= set(limits)
    assert here.at("go2/pose").iri == here["go2"].properties["pose"].iri


def test_a_joint_is_moved_and_followed_to_its_end(joint: Thing) -> None:
    run = joint.actions["rotate"](value=10, unit="deg")
    assert run.wait(60) == "succeeded"
    assert run.target
    assert math.isclose(angle(joint), 10, abs_tol=0.5)


def test_limits_are_known_before_anything_is_sent(joint: Thing) -> None:
    rotate = joint.actions["rotate"]
    with pytest.raises(InvalidInput, match=r"value: 100 is not from -123\.01\d* to 59\.98\d*"):
        rotate(value=100, unit="deg")
    with pytest.raises(InvalidInput, match="one of deg, rad"):
        rotate(value=1)


def test_every_action_of_joints_of_every_kind_has_a_form_that_it_accepts_itself(here: Fleet) -> None:
    """A body in the middle of each range, in each unit, conforms to the served shape."""
    moving = [part for part in here["tiago"].parts if "Joint" in part.kind and len(part.actions)]
    assert len(moving) > 10
    for part in {part.kind: part for part in moving}.values():
        for action in part.actions:
            fields = {field.name: field for field in action.fields}
            for limits in fields["value"].limits if "value" in fields else ():
                assert limits.lower
                assert limits.upper
                body = action.build(value=(limits.lower.value + limits.upper.value) / 2, unit=limits.when["unit"][0])
                action.validate(body)


def test_changes_are_told(joint: Thing) -> None:
    """The first message is the present state; a motion causes more."""
    rotation = joint.properties["rotation"]
    feed = iter(rotation.subscribe(timeout_s=60))
    first = next(feed)
    assert first.reading.main is not None
    start = angle(joint)
    joint.actions["rotate"](value=start - 8 if start > 0 else start + 8, unit="deg")
    seen = {change.version for change, _ in zip(feed, range(3), strict=False)}
    assert len(seen) == 3
    assert first.version not in seen


def test_a_subscription_with_an_interval_is_made_in_the_linked_container(joint: Thing) -> None:
    feed = joint.subscribe(depth=LF.thisAlone, interval_s=0.5, timeout_s=20)
    change = next(iter(feed))
    assert (change.resource, change.version is not None) == (joint.node, True)


def test_a_refusal_of_the_server_has_its_report(joint: Thing) -> None:
    action = joint.actions["rotate"]
    body = action.build(value=1, unit="deg").serialize().replace(" 1", " 500", 1)
    method, url = action.binding()
    with pytest.raises(Problem) as refused:
        joint.web.send(method, url, body.encode(), {"content-type": "text/turtle"})
    assert (refused.value.status, refused.value.title) == (422, "The content breaks a constraint")
    assert any("numericalValue" in message and "59.98" in message for message in refused.value.messages)


def test_joints_are_moved_together_by_name(here: Fleet) -> None:
    """Joints are given as a thing, a name and a path in nested input."""
    robot = here["ur5"]
    elbow, wrist = robot["elbow_joint"], robot["wrist_1_joint"]
    move = robot.actions["moveJoints"]
    target = [
        {"joint": elbow, "value": 20, "unit": "deg"},
        {"joint": "wrist_1_joint", "value": 0.3, "unit": "rad"},
        {"joint": "ur5/wrist_2_joint", "value": -10, "unit": "deg"},
    ]
    assert move(target=target).wait(60) == "succeeded"
    assert math.isclose(angle(elbow), 20, abs_tol=0.5)
    assert math.isclose(angle(wrist), math.degrees(0.3), abs_tol=0.5)
    with pytest.raises(InvalidInput, match=r"target\[1\]\.value: 500 is not from -?[\d.]+ to [\d.]+"):
        move(target=[target[0], {"joint": wrist, "value": 500, "unit": "deg"}])


def test_a_rehearsal_moves_nothing_and_says_what_would_be(joint: Thing) -> None:
    before = angle(joint)
    would = joint.actions["rotate"].rehearse(value=before - 5 if before > 0 else before + 5, unit="deg")
    duration = would.values["duration"]
    assert isinstance(duration, Quantity)
    assert duration.unit_label == "s"
    assert duration.number
    assert math.isclose(angle(joint), before, abs_tol=0.01)


def test_a_motion_is_cancelled_by_its_own_action(here: Fleet) -> None:
    pan = here["panda"]["panda_joint1"]
    run = pan.actions["rotate"](value=120, unit="deg", speed={"value": 2, "unit": "deg/s"})
    eventually(lambda: run.state == "running", "the motion to begin")
    run.cancel()
    assert run.wait(60) == "cancelled"
    assert run.progress is not None
    assert run.progress < 1


def test_the_types_determine_the_kind_of_thing(here: Fleet, joint: Thing) -> None:
    run = joint.actions["rotate"](value=angle(joint), unit="deg")
    assert isinstance(here.get(run.iri), Invocation)
    assert isinstance(here.get(joint.iri), Thing)
    assert eventually(lambda: run.ended, "the end of the motion")
