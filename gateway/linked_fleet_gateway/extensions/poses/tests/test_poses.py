"""Poses are saved, shared by gateways, taken by the robot's own actions, and refused with a reason."""

import contextlib
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import httpx
import pytest
import rdflib
from rdflib import URIRef

from browser import DCTERMS, LDP, LF, VOM, Browser, Page
from gateway_group import Gateway, gateways, hub
from linked_fleet_gateway.api import KeptPose
from linked_fleet_gateway.faces import named_poses, pose_finding
from redis_servers import Servers, single
from running import Process, eventually, process
from small_fleet import Place, live, offline

pytestmark = pytest.mark.virtual
JSON = {"accept": "application/json"}
DEG = "http://qudt.org/vocab/unit/DEG"
METRE = "http://qudt.org/vocab/unit/M"


@dataclass
class Hall:
    """Two gateways with an arm and a robot of two arms."""

    memory: Servers
    one: Gateway
    other: Gateway
    agents: Process

    @property
    def browser(self) -> Browser:
        return self.one.browser

    def url(self, robot: str = "ur5", at: Gateway | None = None) -> str:
        return f"{(at or self.one).browser.root}{robot}/poses"

    def save(self, robot: str = "ur5", at: Gateway | None = None, **said: object) -> httpx.Response:
        return (at or self.one).browser.http.post(self.url(robot, at), json=said)

    def joint(self, name: str, robot: str = "ur5") -> str:
        return f"{self.browser.root}{robot}/{name}"

    def target(self, joint: str, value: float, unit: str = DEG) -> dict[str, object]:
        return {"joint": self.joint(joint), "value": value, "unit": unit}


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Hall]:
    with single(tmp_path_factory.mktemp("redis")) as memory, hub() as centre, contextlib.ExitStack() as stack:
        names = ("--robot=ur5=ur5", "--robot=baxter=baxter")
        agents = stack.enter_context(process("-m", "linked_fleet_agent", *names, "--connect", centre.endpoint))
        one, other = stack.enter_context(gateways(centre, memory.url))
        for gateway in (one, other):
            for robot in ("ur5", "baxter"):
                live(gateway.browser, robot)
        yield Hall(memory, one, other, agents)


@pytest.fixture
def hall(running: Hall) -> Iterator[Hall]:
    """Yield the hall without poses."""
    yield running
    for robot in ("ur5", "baxter"):
        for each in _members(running.browser.page(running.url(robot))):
            running.browser.http.delete(str(each))


def _members(page: Page) -> list[str]:
    return [str(each) for each in page.graph.objects(page.iri, LDP.contains)]


def _positions(page: Page) -> dict[str, float]:
    graph = page.graph
    found = dict[str, float]()
    for target in graph.objects(page.iri, LF.target):
        joint, value = graph.value(target, LF.ofJoint), graph.value(target, VOM.numericalValue)
        found[str(joint).rpartition("/")[2]] = float(str(value))
    return found


def _names(hall: Hall, at: Gateway | None = None) -> set[str]:
    """Return the poses that the motion action of the arm takes."""
    browser = (at or hall.one).browser
    answer = browser.http.get(f"{browser.root}ur5/actions/assumePose", headers={"accept": "text/turtle"})
    graph = rdflib.Graph().parse(data=answer.text, format="turtle")
    heads = graph.objects(None, URIRef("http://www.w3.org/ns/shacl#in"))
    return {str(each) for head in heads for each in graph.items(head)}


def _saves_the_present_positions(hall: Hall, robot: str, count: int) -> Page:
    made = hall.save(robot, title="here", note="above the table")
    assert made.status_code == 201, made.text
    page = hall.browser.page(made.headers["location"])
    assert len(_positions(page)) == count
    return page


def test_the_present_positions_of_all_joints_are_saved(hall: Hall) -> None:
    page = _saves_the_present_positions(hall, "ur5", 6)
    state = hall.browser.http.get(hall.browser.root + "ur5/shoulder_pan_joint/rotation", headers=JSON).json()
    assert _positions(page)["shoulder_pan_joint"] == pytest.approx(state["value"], abs=1e-4)
    said = page.graph
    assert (page.iri, LF.ofRobot, URIRef(hall.browser.root + "ur5/")) in said
    assert (page.iri, rdflib.RDFS.comment, rdflib.Literal("above the table")) in said
    assert page.one(LF.savedBy) and page.one(DCTERMS.modified)


def test_the_joints_of_one_arm_are_saved_alone(hall: Hall) -> None:
    page = hall.browser.page(hall.url("baxter"))
    groups = {
        str(page.graph.value(node, DCTERMS.title)): [str(each) for each in page.graph.objects(node, LF.ofJoint)]
        for node in page.graph.objects(page.iri, LF.jointGroup)
    }
    (left,) = (joints for name, joints in groups.items() if name.startswith("left_s0"))
    made = hall.save("baxter", title="left", joints=left)
    assert made.status_code == 201, made.text
    saved = _positions(hall.browser.page(made.headers["location"]))
    assert saved.keys() == {each.rpartition("/")[2] for each in left}
    assert all(each.startswith("left_") for each in saved) and "left_w2" in saved


def test_poses_are_given_by_values_in_units(hall: Hall) -> None:
    made = hall.save(title="elbow up", targets=[hall.target("elbow_joint", 90)])
    assert made.status_code == 201, made.text
    assert _positions(hall.browser.page(made.headers["location"])) == {"elbow_joint": pytest.approx(math.pi / 2)}
    read = hall.browser.http.get(made.headers["location"], headers=JSON).json()
    assert read["title"] == "elbow up" and len(read["targets"]) == 1


@pytest.mark.parametrize(
    ("joint", "value", "unit", "says"),
    [
        ("elbow_joint", 999, DEG, "outside its limits"),
        ("elbow_joint", 1, METRE, "has the unit DEG or RAD"),
        ("nose", 1, DEG, "no joint at"),
        ("ee_fixed_joint", 1, DEG, "takes no commands"),
    ],
)
def test_what_a_robot_cannot_assume_is_refused(hall: Hall, joint: str, value: float, unit: str, says: str) -> None:
    answer = hall.save(title="no", targets=[hall.target(joint, value, unit)])
    assert answer.status_code == 422 and says in answer.json()["detail"], answer.text
    assert not _members(hall.browser.page(hall.url()))


def test_what_is_said_twice_is_refused(hall: Hall) -> None:
    twice = [hall.target("elbow_joint", 1), hall.target("elbow_joint", 2)]
    assert "Two targets name elbow_joint" in hall.save(title="no", targets=twice).text
    both = hall.save(title="no", targets=twice[:1], joints=[hall.joint("elbow_joint")])
    assert both.status_code == 422 and "leave out one of them" in both.text
    foreign = {"joint": "http://elsewhere.example/ur5/elbow_joint", "value": 1, "unit": DEG}
    answer = hall.save(title="no", targets=[foreign])
    assert answer.status_code == 422 and "are below" in answer.text
    for title in ("", " ", "a\nb"):
        assert hall.save(title=title).status_code == 422


def test_a_name_stands_for_one_pose(hall: Hall) -> None:
    assert hall.save(title="here").status_code == 201
    second = hall.save(title="here")
    assert second.status_code == 409 and "a pose 'here' of ur5 already, at /ur5/poses/" in second.text
    own = hall.save(title="upright")
    assert own.status_code == 409 and "ur5 itself names a pose 'upright'" in own.text
    assert hall.save("baxter", title="here").status_code == 201


def test_a_pose_is_replaced_and_patched_unless_others_have_changed_it(hall: Hall) -> None:
    url = hall.save(title="here", targets=[hall.target("elbow_joint", 10)]).headers["location"]
    http = hall.browser.http
    tag = http.get(url, headers={"accept": "text/turtle"}).headers["etag"]
    said = {"title": "there", "targets": [hall.target("elbow_joint", 20)]}
    assert http.put(url, json=said, headers={"if-match": '"other"'}).status_code == 412
    assert http.put(url, json=said, headers={"if-match": tag}).status_code == 204
    assert http.put(url, json=said, headers={"if-match": tag}).status_code == 412
    turtle = http.get(url, headers={"accept": "text/turtle"})
    again = http.put(url, content=turtle.content, headers={"content-type": "text/turtle"})
    assert again.status_code == 204, again.text  # as it was read
    patch = "INSERT DATA { <> <http://www.w3.org/2000/01/rdf-schema#comment> 'mind the cable' }"
    answer = http.patch(url, content=patch, headers={"content-type": "application/sparql-update"})
    assert answer.status_code == 204, answer.text
    page = hall.browser.page(url)
    assert (page.iri, rdflib.RDFS.comment, rdflib.Literal("mind the cable")) in page.graph
    assert _positions(page) == {"elbow_joint": pytest.approx(math.radians(20))}
    assert http.put(url, json={"title": "there"}).status_code == 204  # taught again
    assert len(_positions(hall.browser.page(url))) == 6
    assert http.delete(url).status_code == 204 and http.get(url).status_code == 404


def test_a_dry_run_saves_nothing(hall: Hall) -> None:
    answer = hall.browser.http.post(hall.url(), json={"title": "here"}, headers={"prefer": "dry-run"})
    assert answer.status_code == 204 and not _members(hall.browser.page(hall.url()))


def test_gateways_share_poses(hall: Hall) -> None:
    url = hall.save(title="here").headers["location"]
    path = url.removeprefix(hall.browser.root)
    there = hall.other.browser.root + path
    eventually(lambda: hall.other.get(there).status_code == 200, "the pose at the other gateway")
    eventually(lambda: "here" in _names(hall, hall.other), "the action of the other gateway takes it")
    assert hall.other.browser.http.delete(there).status_code == 204
    eventually(lambda: hall.browser.http.get(url).status_code == 404, "it is deleted here")
    eventually(lambda: "here" not in _names(hall), "the action takes it no longer")


def test_the_motion_action_takes_a_saved_pose(hall: Hall) -> None:
    action, http = hall.browser.root + "ur5/actions/assumePose", hall.browser.http
    unknown = http.post(action, json={"pose": "elbow up"})
    assert unknown.status_code == 422
    hall.save(title="elbow up", targets=[hall.target("elbow_joint", 60)])
    assert "elbow up" in _names(hall)
    robot = hall.browser.robot("ur5")
    named = [each for each in robot.graph.objects(robot.iri, LF.namedPose) if isinstance(each, URIRef)]
    assert [str(robot.graph.value(each, DCTERMS.title)) for each in named] == ["elbow up"]
    rehearsed = http.post(action, json={"pose": "elbow up"}, headers={"prefer": "dry-run", **JSON})
    assert rehearsed.status_code == 200, rehearsed.text
    headers = {"idempotency-key": '"once"', "prefer": "wait=20"}
    done = http.post(action, json={"pose": "elbow up"}, headers=headers)
    assert done.status_code == 204, done.text
    again = http.post(action, json={"pose": "elbow up"}, headers=headers)
    assert again.headers["location"] == done.headers["location"]
    elbow = hall.browser.root + "ur5/elbow_joint/rotation"
    eventually(lambda: abs(http.get(elbow, headers=JSON).json()["value"] - math.radians(60)) < 1e-3, "the elbow is up")


def test_poses_are_not_saved_while_redis_is_away(hall: Hall) -> None:
    url = hall.save(title="here").headers["location"]
    try:
        hall.memory.kill()
        answer = hall.save(title="there")
        assert answer.status_code == 503 and "retry-after" in answer.headers, answer.text
        tags = hall.browser.http.put(hall.browser.root + "ur5/tags", json={"tags": ["x"]})
        assert answer.json()["detail"] == tags.json()["detail"]
        assert hall.browser.http.get(url).status_code == 200  # readable meanwhile
    finally:
        hall.memory.start()
    eventually(lambda: hall.save(title="there").status_code == 201, "poses are saved again")


def test_poses_are_deleted_with_their_robot(tmp_path_factory: pytest.TempPathFactory) -> None:
    """While it is offline they stay, and no present positions are saved."""
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (_, browser):
        url = f"{browser.root}ur5/poses"
        with place.ur5():
            live(browser, "ur5")
            assert browser.http.post(url, json={"title": "here"}).status_code == 201
        robot = offline(browser, "ur5").url
        assert len(_members(browser.page(url))) == 1
        answer = browser.http.post(url, json={"title": "there"})
        assert answer.status_code == 409 and "ur5 is offline" in answer.text
        assert browser.http.delete(robot).status_code == 204
        with place.ur5():
            live(browser, "ur5")
            assert not _members(browser.page(url))
            assert browser.http.post(url, json={"title": "here"}).status_code == 201


def test_a_pose_that_fits_no_longer_says_why(bench: Any) -> None:
    """It stays, is named by its robot with the reason, and is taken by no action."""
    joint = {"elbow": ("revolute", '<limit lower="-1" upper="2" velocity="1" effort="1"/>')}
    robot = bench.robot(joint)
    kept = {"up": KeptPose("/r/poses/1", {"elbow": 1.0}), "far": KeptPose("/r/poses/2", {"elbow": 3.0})}
    robot.set_poses(kept | {"gone": KeptPose("/r/poses/3", {"wrist": 1.0})})
    assert named_poses(robot) == {"up": {"elbow": 1.0}}
    assert pose_finding(robot, {"elbow": 3.0}) == "elbow would be at 3, outside its limits -1.0 to 2.0 (SI units)."
    assert pose_finding(robot, {"wrist": 1.0}) == "r has no joint wrist."
