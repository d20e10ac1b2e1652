"""Missions at two gateways with one Redis and a robot that they move."""

import contextlib
import functools
import json
import signal
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import httpx
import pyshacl
import pytest
import rdflib
from jsonschema import Draft202012Validator

from browser import HYBRIT, LF, SH
from commanding import control, put
from gateway_group import Gateway, Hub, gateways, hub
from linked_fleet_gateway.extensions.missions.schema import SCHEMA
from redis_servers import Servers, single
from rules_client import sides
from running import eventually, process
from small_fleet import live

pytestmark = pytest.mark.virtual
RAD = "http://qudt.org/vocab/unit/RAD"
DEEP: dict[str, Any] = functools.reduce(lambda inner, _: {"a": inner}, range(30), {})


@dataclass
class Scene:
    """Two gateways, and the address of the actions of the robot's joints."""

    memory: Servers
    hub: Hub
    one: Gateway
    other: Gateway

    def rotate(self, joint: str, angle: float | dict[str, str], name: str = "", speed: float = 0.0) -> dict[str, Any]:
        """Return a step that turns a joint."""
        body: dict[str, Any] = {"value": angle, "unit": RAD}
        if speed:
            body["speedScale"] = speed
        action = f"{self.one.browser.root}ur5/{joint}/actions/rotate"
        return {"type": "invoke", "action": action, "body": body, **({"name": name} if name else {})}

    def post(self, step: dict[str, Any], **more: Any) -> httpx.Response:
        said = {"title": "a mission", "step": step, **more}
        return self.one.browser.http.post(self.one.browser.root + "missions", json=said)

    def mission(self, *steps: dict[str, Any], **more: Any) -> str:
        """Post a mission of a sequence and return its IRI."""
        answer = self.post({"type": "sequence", "steps": list(steps)}, **more)
        assert answer.status_code == 201, answer.text
        return answer.headers["location"]

    def run(self, mission: str, values: dict[str, Any] | None = None, **fields: str) -> "Run":
        url = mission + "/actions/run"
        answer = self.one.browser.http.post(url, json=values, headers=fields) if values is not None else (
            self.one.browser.http.post(url, headers=fields))  # fmt: skip
        assert answer.status_code in (201, 202, 204), answer.text
        return Run(self, answer.headers["location"])

    def refused(self) -> dict[str, Any]:
        """Return a step that the robot refuses."""
        joint = f"{self.one.browser.root}ur5/wrist_2_joint"
        precondition = {"joint": joint, "value": 3, "unit": RAD, "tolerance": 0.01}
        step = self.rotate("wrist_2_joint", 0.1)
        return step | {"body": step["body"] | {"precondition": [precondition]}}


@dataclass
class Run:
    """A run, as seen at one of the gateways."""

    scene: Scene
    invocation: str

    def at(self, gateway: Gateway) -> rdflib.Graph:
        url = f"{gateway.browser.root}mission-runs/{self.invocation.rpartition('/')[2]}"
        eventually(lambda: gateway.get(url).status_code == 200, "the run at the gateway")
        answer = gateway.get(url)
        return rdflib.Graph().parse(data=answer.text, format="turtle")

    def state(self, gateway: Gateway | None = None) -> str:
        at = gateway or self.scene.one
        page = at.browser.page(at.here(self.invocation))
        return str(page.one(LF.state)).rpartition("#")[2]

    def reason(self, gateway: Gateway | None = None) -> str:
        at = gateway or self.scene.one
        return str(at.browser.page(at.here(self.invocation)).one(LF.reason))

    def steps(self, gateway: Gateway | None = None) -> dict[str, str]:
        """Return the states of steps by their paths."""
        graph = self.at(gateway or self.scene.one)
        return {
            str(graph.value(node, LF.stepPath)): str(graph.value(node, LF.state)).rpartition("#")[2]
            for node in graph.subjects(rdflib.RDF.type, LF.StepRun)
        }

    def invocations(self, gateway: Gateway | None = None) -> list[str]:
        graph = self.at(gateway or self.scene.one)
        nodes = graph.subjects(rdflib.RDF.type, LF.StepRun)
        return [str(each) for node in nodes for each in graph.objects(node, LF.invocation)]

    def ends(self, state: str, gateway: Gateway | None = None) -> None:
        eventually(lambda: self.state(gateway) == state, lambda: f"{state}, not {self.state(gateway)}")

    def do(self, action: str, body: dict[str, Any] | None = None) -> httpx.Response:
        url = f"{self.scene.one.browser.root}mission-runs/{self.invocation.rpartition('/')[2]}/actions/{action}"
        http = self.scene.one.browser.http
        return http.post(url) if body is None else http.post(url, json=body)


def holder_of(gateway: Gateway, lease: str) -> str:
    """Return who has a lease; empty if nobody has it."""
    return "".join(map(str, gateway.browser.page(lease).graph.objects(None, LF.holder)))


@pytest.fixture
def scene(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Scene]:
    with single(tmp_path_factory.mktemp("redis")) as memory, hub() as centre, contextlib.ExitStack() as stack:
        stack.enter_context(process("-m", "linked_fleet_agent", "--robot=ur5", "--connect", centre.endpoint))
        one, other = stack.enter_context(gateways(centre, memory.url))
        for each in (one, other):
            live(each.browser, "ur5")
        yield Scene(memory, centre, one, other)


def test_a_sequence_runs_to_its_end_and_shows_its_parts(scene: Scene) -> None:
    mission = scene.mission(
        scene.rotate("wrist_3_joint", 0.3, "turn"),
        {"type": "notify", "text": "half way"},
        scene.rotate("wrist_3_joint", 0.0),
    )
    run = scene.run(mission)
    run.ends("succeeded")
    assert run.steps(scene.other) == {"0.0": "succeeded", "0.1": "succeeded", "0.2": "succeeded"}
    assert len(run.invocations()) == 2
    other = scene.other.browser
    url = f"{other.root}mission-runs/{run.invocation.rpartition('/')[2]}"
    said = other.http.get(url, headers={"accept": "application/json"}).json()
    assert said["state"] == "succeeded"
    assert [(each["step"], each["type"], each["state"]) for each in said["steps"]] == [
        ("0.0", "invoke", "succeeded"), ("0.1", "notify", "succeeded"), ("0.2", "invoke", "succeeded")
    ]  # fmt: skip
    assert "half way" in {str(each) for each in run.at(scene.one).objects(None, LF.note)}


def test_parameters_are_the_input_of_the_action(scene: Scene) -> None:
    parameters = [{"name": "angle", "type": "number", "minimum": -1, "maximum": 0.3, "title": "where to"}]
    mission = scene.mission(scene.rotate("wrist_3_joint", {"variable": "angle"}), parameters=parameters)
    shape = scene.one.browser.page(mission + "/actions/run")
    assert (None, SH.name, rdflib.Literal("angle")) in shape.graph
    scene.run(mission, {"angle": 0.3}).ends("succeeded")
    for wrong in ({}, {"angle": 2}, {"angle": "far"}, {"angle": 0.2, "other": 1}):
        answer = scene.one.browser.http.post(mission + "/actions/run", json=wrong)
        assert answer.status_code == 422, (wrong, answer.text)
    for least in (-1, -1.0):  # the bounds are values too
        scene.run(mission, {"angle": least}).ends("succeeded")
    run = scene.run(mission, {"angle": 0.2})
    run.ends("succeeded")
    (invocation,) = run.invocations()
    assert '"0.2"' in scene.one.get(invocation).text
    wider = scene.one.browser.http.get(mission, headers={"accept": "application/json"}).json()
    wider["parameters"][0]["maximum"] = 0.6
    assert scene.one.browser.http.put(mission, json=wider).status_code == 204
    scene.run(mission, {"angle": 0.5}).ends("succeeded")


@pytest.mark.parametrize(
    ("step", "says"),
    [
        ({"type": "invoke", "action": "ROOT/ur5/wrist_3_joint/actions/fly"}, "no action at"),
        ({"type": "invoke", "action": "https://example.org/a"}, "no resource of this fleet"),
        (
            {"type": "invoke", "action": "ROOT/ur5/wrist_3_joint/actions/rotate", "body": {"value": 99, "unit": RAD}},
            "99",
        ),
        ({"type": "invoke", "action": "ROOT/ur5/wrist_3_joint/actions/rotate", "body": {"valeu": 1}}, "valeu"),
        ({"type": "invoke", "action": "ROOT/ur5/actions/stop", "body": {"value": 1}}, "takes no body"),
        ({"type": "invoke", "action": "no iri"}, "no IRI"),
        ({"type": "invoke", "action": "ROOT/ur5/wrist_3_joint/actions/rotate", "body": DEEP}, "deep"),
        ({"type": "wait", "until": "9999-12-31T00:00:00Z"}, "years"),
        ({"type": "dance"}, "dance"),
        ({"type": "sequence", "steps": []}, "steps"),
        ({"type": "wait"}, "one of seconds, until and condition"),
        ({"type": "wait", "until": "tomorrow"}, "xsd:dateTime"),
        ({"type": "wait", "seconds": -1}, "seconds"),
        ({"type": "wait", "condition": "SELECT WHERE"}, "condition"),
        ({"type": "repeat", "times": 0, "step": {"type": "notify", "text": "x"}}, "times"),
        ({"type": "invoke", "kind": "https://w3id.org/linked-fleet#Rotate", "of": {"variable": "where"}}, "where"),
    ],
)  # fmt: skip
def test_what_cannot_run_is_refused_with_its_reason(scene: Scene, step: dict[str, Any], says: str) -> None:
    text = json.dumps(step).replace("ROOT/", scene.one.browser.root)
    answer = scene.post(json.loads(text))
    assert answer.status_code == 422, answer.text
    assert says in answer.json()["detail"]


def test_a_mission_can_be_sent_back_as_it_is_served(scene: Scene) -> None:
    mission = scene.mission(
        {"type": "parallel", "steps": [scene.rotate("wrist_3_joint", 0.1), {"type": "wait", "seconds": 1}]},
        {"type": "firstOf", "steps": [{"type": "confirm", "text": "go?"}, {"type": "notify", "text": "no"}]},
        {"type": "repeat", "times": 2, "step": {"type": "wait", "condition": "SELECT ?a WHERE { ?a ?b ?c }"}},
        parameters=[
            {"name": "who", "type": "text", "options": ["a", "b"]},
            {"name": "count", "type": "integer", "default": 3},
        ],
        holds=True,
    )
    http = scene.one.browser.http
    said = http.get(mission, headers={"accept": "application/json"}).json()
    Draft202012Validator(SCHEMA).validate(said)
    turtle = http.get(mission, headers={"accept": "text/turtle"}).text
    answer = http.put(mission, content=turtle, headers={"content-type": "text/turtle"})
    assert answer.status_code == 204, answer.text
    assert http.get(mission, headers={"accept": "application/json"}).json() == said
    assert http.put(mission, json=said).status_code == 204
    page = scene.one.browser.page(mission)
    for blueprint in page.graph.objects(page.iri, HYBRIT.blueprint):
        shapes = scene.one.browser.page(str(blueprint)).graph
        conforms, _, text = pyshacl.validate(page.graph, shacl_graph=shapes)
        assert conforms, text


def test_a_failed_step_ends_the_run_and_cancels_what_runs_beside_it(scene: Scene) -> None:
    far = scene.rotate("wrist_3_joint", 3.0, speed=0.1)
    answer = scene.post({"type": "parallel", "steps": [far, scene.refused()]})
    assert answer.status_code == 201, answer.text
    run = scene.run(answer.headers["location"])
    run.ends("failed")
    assert run.steps() == {"0.0": "cancelled", "0.1": "failed"}


def test_first_of_goes_on_with_the_next_one(scene: Scene) -> None:
    answer = scene.post({"type": "firstOf", "steps": [scene.refused(), scene.rotate("wrist_3_joint", 0.2)]})
    run = scene.run(answer.headers["location"])
    run.ends("succeeded")
    assert run.steps() == {"0.0": "failed", "0.1": "succeeded"}


def test_people_pause_resume_confirm_retry_and_skip(scene: Scene) -> None:
    mission = scene.mission(
        {"type": "confirm", "text": "Is the gripper empty?"}, {"type": "confirm", "text": "And now?"}, holds=True
    )
    run = scene.run(mission)
    eventually(lambda: run.steps() == {"0.0": "waiting"}, "the question")
    assert run.do("pause").status_code == 204
    assert run.do("pause").status_code == 409
    assert run.do("confirm", {"step": "0.0", "confirmed": True}).status_code == 204
    assert run.steps() == {"0.0": "succeeded"}
    assert run.do("resume").status_code == 204
    eventually(lambda: run.steps().get("0.1") == "waiting", "the next question")
    assert run.do("confirm", {"step": "0.1", "confirmed": False}).status_code == 204
    eventually(lambda: (None, LF.state, LF.blocked) in run.at(scene.one), "blocked")
    assert run.state() == "running"
    assert run.do("retry", {"step": "0.1"}).status_code == 204
    eventually(lambda: run.steps().get("0.1") == "waiting", "the question again")
    assert run.do("skip", {"step": "0.7"}).status_code == 422
    assert run.do("skip", {"step": "0.1"}).status_code == 204
    run.ends("succeeded")


def test_a_cancelled_run_stops_its_step(scene: Scene) -> None:
    run = scene.run(scene.mission(scene.rotate("wrist_3_joint", 3.0, speed=0.1), {"type": "notify", "text": "x"}))
    eventually(lambda: run.steps().get("0.0") == "running", "the motion")
    (step,) = run.invocations()
    record = f"{scene.one.browser.root}mission-runs/{run.invocation.rpartition('/')[2]}"
    assert scene.one.browser.http.delete(record).status_code == 409
    assert scene.one.browser.http.post(run.invocation + "/actions/cancel").status_code == 204
    run.ends("cancelled")
    assert str(scene.one.browser.page(step).one(LF.state)).endswith("#cancelled")
    assert scene.one.browser.http.delete(record).status_code == 204


@pytest.mark.parametrize("path", ["actions/stopAll", "ur5/actions/stop"])
def test_a_stop_of_its_robot_ends_a_run(scene: Scene, path: str) -> None:
    run = scene.run(scene.mission({"type": "wait", "seconds": 5}, scene.rotate("wrist_3_joint", 0.5)))
    eventually(lambda: run.steps(scene.other) == {"0.0": "waiting"}, "the wait at the other gateway")
    assert scene.other.browser.http.post(scene.other.browser.root + path).status_code == 204
    run.ends("failed")
    assert "stopped by a client" in run.reason()
    assert run.steps() == {"0.0": "cancelled"}


def test_another_gateway_goes_on_when_one_dies(scene: Scene) -> None:
    mission = scene.mission(
        scene.rotate("wrist_3_joint", 1.0, speed=0.2),
        scene.rotate("wrist_3_joint", 0.0),
        scene.rotate("wrist_3_joint", 0.2),
    )
    run = scene.run(mission)
    eventually(lambda: run.steps(scene.other).get("0.0") == "running", "the first step")
    scene.one.process.send(signal.SIGKILL)
    run.ends("succeeded", scene.other)
    assert run.steps(scene.other) == {"0.0": "succeeded", "0.1": "succeeded", "0.2": "succeeded"}
    assert len(run.invocations(scene.other)) == 3


def test_a_condition_is_waited_for(scene: Scene) -> None:
    condition = sides(f"{scene.one.browser.root}ur5/wrist_3_joint").replace(
        "BIND(?x / 10", "FILTER(?x > 0.4) BIND(?x / 10"
    )
    mission = scene.mission(
        {"type": "wait", "condition": condition, "within": 600}, {"type": "notify", "text": "there"}
    )
    run = scene.run(mission)
    eventually(lambda: run.steps() == {"0.0": "waiting"}, "waits")
    url = f"{scene.one.browser.root}ur5/wrist_3_joint/actions/rotate"
    assert scene.one.browser.http.post(url, json={"value": 0.6, "unit": RAD}).status_code == 204
    run.ends("succeeded")


def test_an_idempotency_key_begins_one_run(scene: Scene) -> None:
    mission = scene.mission({"type": "wait", "seconds": 1})
    fields = {"idempotency-key": '"k"'}
    assert scene.run(mission, **fields).invocation == scene.run(mission, **fields).invocation


def test_a_mission_runs_another_one_but_not_itself(scene: Scene) -> None:
    inner = scene.mission(scene.rotate("wrist_3_joint", 3.0, speed=0.1))
    step = {"type": "invoke", "action": inner + "/actions/run"}
    outer = scene.mission(step)
    run = scene.run(outer)
    eventually(lambda: run.steps() == {"0.0": "running"}, "the inner run")
    (inside,) = run.invocations()
    assert scene.one.browser.http.post(run.invocation + "/actions/cancel").status_code == 204
    run.ends("cancelled")
    assert Run(scene, inside).state() == "cancelled"
    again = {"title": "itself", "step": {"type": "invoke", "action": outer + "/actions/run"}}
    assert scene.one.browser.http.put(inner, json=again).status_code == 204
    answer = scene.one.browser.http.post(outer + "/actions/run")
    assert answer.status_code == 422
    assert "circles" in answer.json()["detail"]


def test_a_lease_of_its_client_counts_for_the_steps(scene: Scene) -> None:
    lease = str(scene.one.browser.robot("ur5").one(LF.lease))
    answer = put(scene.one.browser, lease, control("me", 60))
    token = answer.headers["lock-token"]
    mission = scene.mission(scene.rotate("wrist_3_joint", 0.2))
    run = scene.run(mission, **{"lock-token": token})
    run.ends("succeeded")
    refused = scene.one.browser.http.post(f"{mission}/actions/run")
    assert (refused.status_code, refused.json()["holder"]) == (409, "me"), refused.text
    assert holder_of(scene.one, lease) == "me", "the lease of the client is not the run's"


def test_a_run_has_control_of_its_robots_until_it_is_over(scene: Scene) -> None:
    http, root = scene.one.browser.http, scene.one.browser.root
    lease = str(scene.one.browser.robot("ur5").one(LF.lease))
    mission = scene.mission({"type": "wait", "seconds": 20}, scene.rotate("wrist_3_joint", 0.2))
    run = scene.run(mission)

    def holder() -> str:
        return holder_of(scene.one, lease)

    assert holder().startswith("mission a mission, run by ")
    for refused in (http.post(f"{mission}/actions/run"), http.post(f"{root}ur5/wrist_1_joint/actions/rotate",
                    json={"value": 0.1, "unit": RAD})):  # fmt: skip
        assert (refused.status_code, refused.json()["type"].rpartition("#")[2]) == (409, "controlled")
        assert refused.json()["holder"].startswith("mission a mission")
    assert run.do("pause").status_code == 204
    eventually(lambda: holder() == "", "a run that is paused leaves its robots to others")
    answer = put(scene.one.browser, lease, control("me", 60))
    assert run.do("resume").status_code == 204
    run.ends("failed")
    assert "me" in run.reason()
    fields = {"lock-token": answer.headers["lock-token"]}
    assert http.delete(lease, headers=fields).status_code == 204
    run = scene.run(scene.mission(scene.rotate("wrist_3_joint", 0.3)))
    run.ends("succeeded")
    eventually(lambda: holder() == "", "a run that is over releases its robots")


def test_the_lease_of_a_run_lasts_and_goes_over_to_another_gateway(scene: Scene) -> None:
    lease = str(scene.one.browser.robot("ur5").one(LF.lease))
    mission = scene.mission({"type": "wait", "seconds": 200}, scene.rotate("wrist_3_joint", 0.2))
    run = scene.run(mission)
    scene.one.process.send(signal.SIGKILL)
    at = scene.other.here(lease)
    eventually(lambda: holder_of(scene.other, at), "the lease at the other gateway")
    begun_s = time.monotonic()
    while time.monotonic() < begun_s + 180:
        assert holder_of(scene.other, at), time.monotonic() - begun_s
        time.sleep(5)
    run.ends("succeeded", scene.other)
    eventually(lambda: not holder_of(scene.other, at), "it is released")


def test_a_mission_in_a_mission_uses_the_lease_of_the_outer_run(scene: Scene) -> None:
    inner = scene.mission(scene.rotate("wrist_3_joint", 0.2))
    outer = scene.mission({"type": "invoke", "action": inner + "/actions/run"}, scene.rotate("wrist_3_joint", 0.0))
    scene.run(outer).ends("succeeded")


def test_a_mission_is_changed_by_a_patch(scene: Scene) -> None:
    mission = scene.mission({"type": "wait", "seconds": 1})
    update = """PREFIX dcterms: <http://purl.org/dc/terms/>
        DELETE { <> dcterms:title ?old } INSERT { <> dcterms:title "another" } WHERE { <> dcterms:title ?old }"""
    fields = {"content-type": "application/sparql-update"}
    answer = scene.one.browser.http.patch(mission, content=update, headers=fields)
    assert answer.status_code == 204, answer.text
    said = scene.one.browser.http.get(mission, headers={"accept": "application/json"}).json()
    assert said["title"] == "another"
    assert said["step"]["type"] == "sequence"


def test_what_its_steps_ask_for_is_in_the_audit(scene: Scene) -> None:
    run = scene.run(scene.mission(scene.rotate("wrist_3_joint", 0.2)))
    run.ends("succeeded")
    said = scene.one.get(scene.one.browser.root + "audit").text
    assert "MISSION" in said


def test_an_unknown_outcome_waits_for_the_word_of_the_robot_or_for_a_person(scene: Scene) -> None:
    agent = ("-m", "linked_fleet_agent", "--robot=b=ur5", "--connect", scene.hub.endpoint)
    with process(*agent) as first:
        live(scene.one.browser, "b")
        far = scene.rotate("wrist_3_joint", 3.0, speed=0.1)
        far["action"] = far["action"].replace("/ur5/", "/b/")
        run = scene.run(scene.mission(far, {"type": "notify", "text": "after"}, holds=True))
        eventually(lambda: run.steps() == {"0.0": "running"}, "the motion")
        first.send(signal.SIGKILL)
        eventually(lambda: run.steps() == {"0.0": "unknown"}, lambda: str(run.steps()))
    with process(*agent):
        eventually(lambda: run.steps() == {"0.0": "failed"}, lambda: str(run.steps()))
        assert run.state() == "running"
        assert run.do("retry", {"step": "0.0"}).status_code == 204
        eventually(lambda: run.steps() == {"0.0": "running"}, lambda: str(run.steps()))
        (invocation,) = run.invocations()
        assert scene.one.browser.http.post(invocation + "/actions/cancel").status_code == 204
        eventually(lambda: run.steps() == {"0.0": "cancelled"}, lambda: str(run.steps()))
        assert run.do("skip", {"step": "0.0"}).status_code == 204
        run.ends("succeeded")


def test_nothing_begins_while_redis_is_away_and_the_run_goes_on_afterwards(scene: Scene) -> None:
    run = scene.run(scene.mission({"type": "wait", "seconds": 2}, scene.rotate("wrist_3_joint", 0.2)))
    eventually(lambda: run.steps() == {"0.0": "waiting"}, "the wait")
    scene.memory.kill()
    begun_s = time.monotonic()
    eventually(lambda: time.monotonic() > begun_s + 5, "the wait is over")
    assert run.steps() == {"0.0": "waiting"}
    scene.memory.start()
    run.ends("succeeded")
    assert run.steps() == {"0.0": "succeeded", "0.1": "succeeded"}


def test_pages_show_the_steps_of_a_mission_and_of_its_run(scene: Scene) -> None:
    ask = {"type": "confirm", "text": "Is the way free?"}
    mission = scene.mission({"type": "repeat", "times": 2, "step": ask}, scene.rotate("wrist_3_joint", 0.2, "turn"))
    run = scene.run(mission)
    eventually(lambda: run.steps() == {"0.0.0#0": "waiting"}, "the question")
    root = scene.one.browser.root
    pages = {
        mission: ("One after the other", "2 times", "Is the way free?", "wrist_3_joint/actions/rotate", "actions/run"),
        f"{root}mission-runs/{run.invocation.rpartition('/')[2]}": ("0.0.0#0", "Is the way free?", "actions/confirm"),
        f"{root}missions": (mission, "mission-runs"),
        f"{root}mission-runs": ("a mission", "running"),
    }
    for url, words in pages.items():
        page = scene.one.browser.http.get(url, headers={"accept": "text/html"}).text
        assert all(each in page for each in words), (url, [each for each in words if each not in page])


def test_a_mission_is_written_and_read_as_a_behavior_tree(scene: Scene) -> None:
    tree = f"""<root BTCPP_format="4"><BehaviorTree ID="Turn"><Sequence>
        <Action ID="rotate" name="turn" action="/ur5/wrist_3_joint/actions/rotate" value="{{angle}}" unit="{RAD}"/>
        <Sleep msec="100"/></Sequence></BehaviorTree>
        <TreeNodesModel><SubTree ID="Turn"><input_port name="angle" type="double"/></SubTree></TreeNodesModel></root>"""
    http, as_tree = scene.one.browser.http, {"content-type": "application/vnd.behaviortree+xml"}
    answer = http.post(scene.one.browser.root + "missions", content=tree, headers=as_tree)
    assert answer.status_code == 201, answer.text
    mission = answer.headers["location"]
    run = scene.run(mission, {"angle": 0.2})
    run.ends("succeeded")
    said = http.get(mission, headers={"accept": "application/json"}).json()
    written = http.get(mission, params={"as": "behaviortree"})
    assert written.headers["content-type"] == "application/vnd.behaviortree+xml"
    assert '<Sleep msec="100"/>' in written.text
    assert http.put(mission, content=written.content, headers=as_tree).status_code == 204
    assert http.get(mission, headers={"accept": "application/json"}).json() == said
    for wrong, status in ((tree.replace("Sleep", "Script"), 422), (tree.replace("wrist_3", "no"), 422), ("<root", 400)):
        answer = http.post(scene.one.browser.root + "missions", content=wrong, headers=as_tree)
        assert (answer.status_code == status and "line" in answer.text) or "action" in answer.text, answer.text
