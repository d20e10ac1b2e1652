"""Actions of joints, robots and the fleet beyond Figure 5, on the robots of the demo and one that turns endlessly."""

import math

import pytest
import rdflib
from rdflib import RDF, URIRef

from browser import HYBRIT, LF, MATHS, ROS, Browser, Page
from commanding import ended
from commands import PREFIXES, Commanded, pose_body, scalar
from running import eventually
from shared_fixtures import ROBOTS as ALL
from simulated_robots import TURNTABLE
from small_fleet import number, property_page

pytestmark = pytest.mark.virtual

ROBOTS = (*ALL, f"turntable={TURNTABLE}")

CLOSE_M, CLOSE_RAD = 1e-3, math.radians(0.5)
_OPEN = (LF.accepted, LF.running)
_KINDS = {
    ROS.RevoluteJoint: {LF.Rotate, LF.RotateBy, LF.Hold},
    LF.ContinuousJoint: {LF.Rotate, LF.RotateBy, LF.Hold},
    LF.PrismaticJoint: {LF.Translate, LF.TranslateBy, LF.Hold},
    LF.Robot: {LF.MoveJoints, LF.FollowTrajectory, LF.Reach, LF.StopRobot},
    LF.Fleet: {LF.StopAll, LF.RaiseFault},
}
_SLOWLY = "lf:speed [ vom:numericalValue 0.1 ; vom:unit unit:RAD-PER-SEC ]"


@pytest.fixture(scope="module")
def tiago(browser: Browser) -> Commanded:
    return Commanded(browser, "tiago")


@pytest.fixture(scope="module")
def ur5(browser: Browser) -> Commanded:
    return Commanded(browser, "ur5")


def _positions(client: Commanded) -> dict[str, float]:
    """Return the positions in the robot's joint state, by joint: rad or m."""
    page = client.browser.page(str(client.page.one(LF.jointState)))
    titles = {iri: title for title, iri in client.joints.items()}
    samples = page.graph.objects(page.iri, LF.sample)
    found = {s: (page.graph.value(s, LF.ofJoint), page.graph.value(s, LF.position)) for s in samples}
    return {titles[str(joint)]: float(str(position)) for joint, position in found.values()}


def _kinds(browser: Browser, thing: Page) -> set[object]:
    pages = [browser.page(str(url)) for url in thing.graph.objects(thing.iri, HYBRIT.action)]
    for page in pages:
        assert (page.iri, LF.dryRun, rdflib.Literal(True)) in page.graph, page.url
    return {kind for page in pages for kind in page.types} - {HYBRIT.Action, HYBRIT.AsynchronousAction}


def test_each_thing_links_the_actions_of_its_kind(browser: Browser, tiago: Commanded) -> None:
    """Fleet, robots, and joints of every kind; one that is fixed, mimics or takes no commands has none."""
    assert _kinds(browser, browser.page(browser.root)) == _KINDS[LF.Fleet]
    for robot in browser.robots():
        more = set() if robot.url.endswith("turntable/") else {LF.AssumePose}
        more |= (
            {LF.Relocalise, LF.DriveTo, LF.DriveNear}
            if (robot.iri, LF.baseMobility, rdflib.Literal("floating")) in robot.graph
            else set()
        )
        assert _kinds(browser, robot) == _KINDS[LF.Robot] | more, robot.url
    turning = browser.part("turntable", "turn")
    for joint in (turning, *(browser.page(tiago.joints[title]) for title in ("arm_1_joint", "torso_lift_joint"))):
        (expected,) = [_KINDS[kind] for kind in joint.types if kind in _KINDS]
        assert _kinds(browser, joint) == expected, joint.url
    assert _kinds(browser, browser.page(tiago.joints["wheel_left_joint"])) == set(), "its base turns it"
    fixed = next(url for url in tiago.joints.values() if (URIRef(url), RDF.type, LF.FixedJoint) in tiago.page.graph)
    assert _kinds(browser, browser.page(fixed)) == set()
    assert _kinds(browser, browser.part("panda", "panda_finger_joint2")) == set()


def test_rotate_by_and_translate_by_are_relative(tiago: Commanded) -> None:
    """Each adds to the joint's position; neither is bound to PUT, since twice is not the same as once."""
    tiago.assume("home")
    start = _positions(tiago)
    for _ in range(2):
        tiago.do(LF.RotateBy, scalar(10, "unit:DEG"), "arm_1_joint")
        tiago.do(LF.TranslateBy, scalar(-20, "unit:MilliM"), "torso_lift_joint")
    there = _positions(tiago)
    assert there["arm_1_joint"] == pytest.approx(start["arm_1_joint"] + math.radians(20), abs=CLOSE_RAD)
    assert there["torso_lift_joint"] == pytest.approx(start["torso_lift_joint"] - 0.04, abs=CLOSE_M)
    refused = tiago.ask(LF.RotateBy, scalar(10, "unit:DEG"), "arm_1_joint", method="PUT")
    assert (refused.status_code, "POST" in refused.headers["allow"]) == (405, True)
    assert "PUT" not in refused.headers["allow"]


def test_relative_motion_beyond_the_limits_is_a_conflict(tiago: Commanded) -> None:
    """The body is valid, but the joint is in the wrong place for it: 409 that names the limits."""
    tiago.assume("home")
    before = _positions(tiago)["torso_lift_joint"]
    answer = tiago.ask(LF.TranslateBy, scalar(0.3, "unit:M"), "torso_lift_joint")
    assert (answer.status_code, answer.headers["content-type"]) == (409, "application/problem+json")
    assert "0.35" in answer.json()["detail"]
    assert _positions(tiago)["torso_lift_joint"] == pytest.approx(before, abs=1e-4)


def test_speed_is_optional_and_respected(ur5: Commanded) -> None:
    """The motion takes as long as at that speed; without it the joint would be ten times as fast.

    After a late tick a joint catches up: how exactly the speed is kept is measured elsewhere, on a simulated clock.
    """
    ur5.assume("home")
    joint = "wrist_1_joint"
    url = ur5.begin(LF.RotateBy, scalar(0.3, more=_SLOWLY), joint)
    speeds = []
    while ur5.browser.page(url).one(LF.state) in _OPEN:
        speeds.append(abs(float(str(number(property_page(ur5.browser, "ur5", joint, LF.velocity), LF.value)))))
    done = ur5.browser.page(url)
    assert done.one(LF.state) == LF.succeeded
    assert number(done, LF.duration) > 3.0
    assert 0.05 < max(speeds) < 0.2


def test_speed_above_the_limit_of_the_joint_is_refused(ur5: Commanded) -> None:
    fast = "lf:speed [ vom:numericalValue 4 ; vom:unit unit:RAD-PER-SEC ]"
    answer = ur5.ask(LF.Rotate, scalar(0.3, more=fast), "wrist_1_joint")
    assert (answer.status_code, "3.2" in answer.json()["detail"]) == (422, True)


def test_hold_cancels_the_motion_of_the_joint(ur5: Commanded) -> None:
    """No body; the joint stays short of its target, and the invocations of motion and hold refer to each other."""
    ur5.assume("home")
    motion = ur5.begin(LF.Rotate, scalar(1.5, more=_SLOWLY), "shoulder_pan_joint")
    eventually(lambda: _positions(ur5)["shoulder_pan_joint"] > 0.05, "a motion under way")
    hold = ur5.do(LF.Hold, joint="shoulder_pan_joint")
    page = ended(ur5.browser, motion)
    assert (page.one(LF.state), page.one(LF.preemptedBy)) == (LF.cancelled, hold.iri)
    assert hold.one(LF.preempts) == page.iri
    assert 0.05 < _positions(ur5)["shoulder_pan_joint"] < 1.4


def test_move_joints_arrives_and_may_be_put_again(tiago: Commanded) -> None:
    """Degree, radian, metre and millimetre in one body; a second PUT changes nothing."""
    tiago.assume("home")
    wanted = {"arm_1_joint": ("40", "maths:Degree"), "arm_2_joint": ("-0.4", "unit:RAD")}
    wanted |= {"torso_lift_joint": ("180", "unit:MilliM"), "head_1_joint": ("0.2", "vom:Radian")}
    targets = (
        f"[ lf:ofJoint <{tiago.joints[name]}> ; vom:numericalValue {value} ; vom:unit {unit} ]"
        for name, (value, unit) in wanted.items()
    )
    body = f"<> lf:target {', '.join(targets)} ."
    ends = {"arm_1_joint": math.radians(40), "arm_2_joint": -0.4, "torso_lift_joint": 0.18, "head_1_joint": 0.2}
    for _ in range(2):
        tiago.do(LF.MoveJoints, body, method="PUT")
        there = _positions(tiago)
        assert {name: there[name] for name in ends} == pytest.approx(ends, abs=CLOSE_M)


def test_follow_trajectory_ends_at_the_last_waypoint(ur5: Commanded) -> None:
    """Waypoints in any order, sorted by time; the duration is that of the last one."""
    ur5.assume("home")
    last = {"shoulder_pan_joint": 0.5, "wrist_3_joint": -0.5}
    rows = {3.0: last, 1.5: {"shoulder_pan_joint": 0.3, "wrist_3_joint": -0.2}}
    done = ur5.do(LF.FollowTrajectory, ur5.waypoints(rows))
    assert number(done, LF.duration) == pytest.approx(3.0)
    there = _positions(ur5)
    assert {name: there[name] for name in last} == pytest.approx(last, abs=CLOSE_M)


def test_reach_brings_a_link_to_a_position(ur5: Commanded) -> None:
    """50 mm to the side of the link's present pose: afterwards the pose is correct within 1 mm."""
    ur5.assume("home")

    def position() -> tuple[float, ...]:
        page = property_page(ur5.browser, "ur5", "tool0", LF.pose)
        vector = page.graph.value(page.iri, LF.position)
        return tuple(float(str(page.graph.value(vector, axis))) for axis in (MATHS.x, MATHS.y, MATHS.z))

    x, y, z = position()
    wanted = (x, y + 0.05, z)
    ur5.do(LF.Reach, pose_body(ur5.links["tool0"], wanted))
    assert math.dist(position(), wanted) <= CLOSE_M


def test_unreachable_pose_says_how_far_off_it_is(ur5: Commanded) -> None:
    """422 with the residual in metre; nothing moves."""
    before = _positions(ur5)
    answer = ur5.ask(LF.Reach, pose_body(ur5.links["tool0"], (3.0, 0.0, 0.5)))
    assert (answer.status_code, answer.json()["type"].rpartition("#")[2]) == (422, "out-of-reach")
    assert 1.9 < answer.json()["residual_m"] < 2.3
    assert _positions(ur5) == pytest.approx(before, abs=1e-4)


def test_assume_pose_takes_the_names_of_the_annotations(ur5: Commanded) -> None:
    ur5.assume("upright")
    assert _positions(ur5)["elbow_joint"] == pytest.approx(0.0, abs=CLOSE_RAD)
    ur5.assume("home")
    assert _positions(ur5)["elbow_joint"] == pytest.approx(1.5708, abs=CLOSE_RAD)
    unknown = ur5.ask(LF.AssumePose, '<> lf:poseName "nowhere" .')
    assert (unknown.status_code, "upright" in unknown.json()["detail"]) == (422, True)


def test_stop_cancels_all_motions_of_the_robot(ur5: Commanded) -> None:
    """Two simultaneous motions of different joints are both cancelled."""
    ur5.assume("home")
    motions = [ur5.begin(LF.Rotate, scalar(1.5, more=_SLOWLY), j) for j in ("shoulder_pan_joint", "wrist_3_joint")]
    eventually(lambda: _positions(ur5)["wrist_3_joint"] > 0.05, "both under way")
    stop = ur5.do(LF.StopRobot)
    assert {str(each) for each in stop.graph.objects(stop.iri, LF.preempts)} == set(motions)
    assert {ended(ur5.browser, url).one(LF.state) for url in motions} == {LF.cancelled}


def test_stop_all_is_answered_by_every_robot(browser: Browser, ur5: Commanded, tiago: Commanded) -> None:
    """All robots answer the fleet's invocation, and the motions of two of them end by it."""
    for client in (ur5, tiago):
        client.assume("home")
    motions = [ur5.begin(LF.Rotate, scalar(1.5, more=_SLOWLY), "shoulder_pan_joint")]
    motions.append(tiago.begin(LF.Rotate, scalar(1.5, more=_SLOWLY), "arm_1_joint"))
    url = browser.action(browser.page(browser.root), LF.StopAll)
    answer = browser.http.post(url, headers={"prefer": "wait=15"})
    assert answer.status_code == 204, answer.text
    stop = browser.page(answer.headers["location"])
    assert stop.one(LF.state) == LF.succeeded
    answered = {str(stop.graph.value(node, LF.ofRobot)) for node in stop.graph.objects(stop.iri, LF.answer)}
    assert answered == {robot.url for robot in browser.robots()}
    assert {ended(browser, url).one(LF.state) for url in motions} == {LF.cancelled}


def test_dry_run_moves_nothing(ur5: Commanded) -> None:
    """200 with a rehearsal and its duration; Preference-Applied names it, there is no Location."""
    ur5.assume("home")
    before = _positions(ur5)
    answer = ur5.ask(LF.Rotate, scalar(1.5), "shoulder_pan_joint", prefer="dry-run")
    assert (answer.status_code, answer.headers["preference-applied"]) == (200, "dry-run")
    assert "location" not in answer.headers
    graph = rdflib.Graph().parse(data=answer.text, format="turtle")
    assert (None, RDF.type, LF.Rehearsal) in graph
    assert _positions(ur5) == pytest.approx(before, abs=1e-3)  # it may still settle


def test_statements_outside_the_shape_are_ignored(ur5: Commanded) -> None:
    """JSON-LD with foreign types and predicates at every level works as without them."""
    ur5.assume("home")
    body = {
        "@context": ["https://w3id.org/linked-fleet/context", {"ex": "http://example.org/"}],
        "@id": "",
        "@type": "ex:Wish",
        "lf:target": {
            "@type": "ex:Place",
            "lf:ofJoint": {"@id": ur5.joints["wrist_3_joint"]},
            "vom:numericalValue": 20,
            "vom:unit": {"@id": "unit:DEG"},
            "ex:why": {"ex:because": "it is in the way"},
        },
    }
    sent = {"content-type": "application/ld+json", "prefer": "wait=15"}
    answer = ur5.browser.http.post(ur5.action(LF.MoveJoints), json=body, headers=sent)
    assert answer.status_code == 204, answer.text
    assert _positions(ur5)["wrist_3_joint"] == pytest.approx(math.radians(20), abs=CLOSE_RAD)


def test_a_motion_right_after_a_stop_is_none_of_those_before(browser: Browser) -> None:
    """Commands overtaken by a stop are refused as stale; those sent after its answer are not."""
    robot = Commanded(browser, "ur5")
    rotate, stop = robot.action(LF.Rotate, "wrist_1_joint"), browser.action(robot.page, LF.StopRobot)
    for turn in range(20):
        assert browser.http.post(stop).status_code == 204
        body = PREFIXES + scalar(-1.5 + 0.02 * (turn % 2))
        answer = browser.http.put(rotate, content=body, headers={"content-type": "text/turtle"})
        assert answer.status_code == 204, answer.text
