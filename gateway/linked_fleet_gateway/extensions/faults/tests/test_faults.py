"""Faults of two gateways with one Redis and robots, as clients see them."""

import contextlib
import signal
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pyshacl
import pytest
import rdflib
from rdflib import URIRef

from browser import DCTERMS, HYBRIT, LDP, LF
from gateway_group import Gateway, Hub, gateways, hub
from linked_fleet_gateway.extensions.recordings import recorder
from redis_servers import single
from running import Process, eventually, process
from small_fleet import live

pytestmark = pytest.mark.virtual
RAD = "http://qudt.org/vocab/unit/RAD"


@dataclass
class Scene:
    one: Gateway
    other: Gateway
    hub: Hub
    agent: Process

    def faults(self, gateway: Gateway | None = None) -> dict[str, dict[str, Any]]:
        """Return the faults by kind, in plain JSON."""
        at = gateway or self.one
        page = at.browser.page(at.browser.root + "faults")
        found = [at.browser.http.get(str(each), headers={"accept": "application/json"}).json()
                 for each in page.graph.objects(page.iri, LDP.contains)]  # fmt: skip
        return {each["faultKind"]: each for each in found}

    def iri(self, kind: str, gateway: Gateway | None = None) -> str:
        at = gateway or self.one
        graph = at.browser.page(at.browser.root + "faults").graph
        (found,) = graph.subjects(LF.faultKind, rdflib.Literal(kind))
        return str(found)

    def state(self, kind: str, gateway: Gateway | None = None) -> str | None:
        found = self.faults(gateway).get(kind)
        return None if found is None else str(found["state"])

    def becomes(self, kind: str, state: str | None, gateway: Gateway | None = None) -> None:
        eventually(lambda: self.state(kind, gateway) == state, lambda: f"{kind} {state}: {self.faults(gateway)}")

    def do(self, kind: str, action: str, body: dict[str, Any] | None = None, gateway: Gateway | None = None) -> int:
        at = gateway or self.one
        url = f"{self.iri(kind, at)}/actions/{action}"
        http = at.browser.http
        answer = http.post(url) if body is None else http.post(url, json=body)
        return answer.status_code

    def raise_(self, **more: object) -> int:
        said = {"about": self.one.browser.root + "ur5/", "title": "It rattles.", **more}
        answer = self.one.browser.http.post(self.one.browser.root + "actions/raiseFault", json=said)
        return answer.status_code


@pytest.fixture
def scene(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Scene]:
    with single(tmp_path_factory.mktemp("redis")) as memory, hub() as centre, contextlib.ExitStack() as stack:
        agent = stack.enter_context(process("-m", "linked_fleet_agent", "--robot=ur5", "--connect", centre.endpoint))
        own = ("--state-dir", str(tmp_path_factory.mktemp("state")))
        one, other = stack.enter_context(gateways(centre, memory.url, flags=own))
        live(one.browser, "ur5")
        live(other.browser, "ur5")
        yield Scene(one, other, centre, agent)


def test_a_robot_that_goes_is_one_fault_at_all_gateways_until_it_is_back(scene: Scene) -> None:
    scene.agent.send(signal.SIGTERM)
    scene.becomes("offline", "confirmed")
    scene.becomes("offline", "confirmed", scene.other)
    said = scene.faults()["offline"]
    assert (said["severity"], said["count"], said["present"]) == ("error", 1, True)
    assert said["about"] == scene.one.browser.root + "ur5/"
    assert scene.do("offline", "clear") == 409, "its trouble is still there"
    assert scene.do("offline", "acknowledge", gateway=scene.other) == 204
    assert scene.do("offline", "remark", {"remark": "it is being serviced"}, scene.other) == 204
    scene.becomes("offline", "acknowledged")
    assert scene.faults()["offline"]["remark"] == "it is being serviced"
    assert scene.do("offline", "acknowledge") == 409
    with process("-m", "linked_fleet_agent", "--robot=ur5", "--connect", scene.hub.endpoint):
        scene.becomes("offline", "cleared")
        assert scene.do("offline", "acknowledge") == 409


def test_the_time_before_a_fault_is_recorded_once_for_each_appearance(scene: Scene) -> None:
    """Each gateway keeps its own, under the same address; information is not recorded."""

    def recording(gateway: Gateway) -> str:
        found = scene.faults(gateway).get("told noise", {}).get("recording", "")
        return str(found).removeprefix(gateway.browser.root)

    assert scene.raise_(faultKind="idea", severity="https://w3id.org/linked-fleet#information") == 204
    assert scene.raise_(faultKind="noise") == 204
    first = eventually(lambda: recording(scene.one), "a recording")
    eventually(lambda: recording(scene.other) == first, "the same at the other gateway")
    page = scene.one.browser.page(scene.one.browser.root + first)
    assert str(page.one(DCTERMS.description)) == "It rattles."
    assert int(str(page.one(LF.byteSize))) > 0
    container = scene.one.browser.page(page.url.rpartition("/")[0])
    assert [str(each) for each in container.graph.objects(None, DCTERMS.description)] == ["It rattles."]
    assert scene.do("told noise", "acknowledge") == 204
    scene.becomes("told noise", "cleared")
    assert "recording" in scene.faults()["told noise"]
    time.sleep(recorder.PAUSE_S)
    assert scene.raise_(faultKind="noise") == 204
    eventually(lambda: recording(scene.one) not in ("", first), "another recording")


def test_what_a_client_raises_is_seen_everywhere_and_counted(scene: Scene) -> None:
    assert scene.raise_(faultKind="noise", severity="https://w3id.org/linked-fleet#warning") == 204
    assert scene.raise_(faultKind="noise") == 204
    scene.becomes("told noise", "confirmed", scene.other)
    eventually(lambda: scene.faults(scene.other)["told noise"]["count"] == 2, "both")
    assert scene.do("told noise", "acknowledge") == 204
    scene.becomes("told noise", "cleared", scene.other)
    assert scene.raise_(latched=True) == 204
    assert scene.do("told", "acknowledge") == 204
    scene.becomes("told", "acknowledged")
    assert scene.do("told", "clear") == 204
    scene.becomes("told", "cleared")


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ({"about": "https://example.org/ur5/"}, "neither a robot"),
        ({"about": "ROOTnobody/"}, "no robot"),
        ({"title": ""}, "title"),
        ({"severity": "https://w3id.org/linked-fleet#awful"}, "severity"),
        ({"faultKind": "a/b"}, "faultKind"),
    ],
)
def test_a_wrong_fault_is_refused_with_its_reason(scene: Scene, more: dict[str, str], says: str) -> None:
    root = scene.one.browser.root
    said = {"about": root + "ur5/", "title": "x"} | {key: value.replace("ROOT", root) for key, value in more.items()}
    answer = scene.one.browser.http.post(root + "actions/raiseFault", json=said)
    assert answer.status_code == 422
    assert says in answer.text


def test_a_fault_conforms_to_its_blueprint_and_is_in_queries(scene: Scene) -> None:
    assert scene.raise_(severity="https://w3id.org/linked-fleet#critical") == 204
    page = scene.one.browser.page(scene.iri("told"))
    blueprint = scene.one.browser.page(str(page.one(HYBRIT.blueprint)))
    conforms, _, text = pyshacl.validate(page.graph, shacl_graph=blueprint.graph, inference="none")
    assert conforms, text
    query = """PREFIX lf: <https://w3id.org/linked-fleet#>
        SELECT ?robot WHERE { ?fault lf:about ?robot ; lf:severity lf:critical ; lf:state lf:faultConfirmed .
          ?robot lf:presence lf:online }"""
    answer = scene.one.browser.http.post(
        scene.one.browser.root + "query", content=query, headers={"content-type": "application/sparql-query"}
    )
    assert scene.one.browser.root + "ur5/" in answer.text


def test_pages_show_what_needs_attention_first(scene: Scene) -> None:
    assert scene.raise_(faultKind="low", severity="https://w3id.org/linked-fleet#warning") == 204
    assert scene.raise_(faultKind="high", severity="https://w3id.org/linked-fleet#critical", title="It burns.") == 204
    html = {"accept": "text/html"}
    answer = scene.one.browser.http.get(scene.one.browser.root + "faults", headers=html)
    assert answer.status_code == 200
    assert "2 open faults" in answer.text
    assert answer.text.index("It burns.</bdi>") < answer.text.index("It rattles.</bdi>")
    assert scene.do("told high", "acknowledge") == 204
    page = scene.one.browser.http.get(scene.iri("told high"), headers=html)
    assert page.status_code == 200
    assert 'data-state="cleared"' in page.text


def test_a_failed_motion_is_a_fault_with_its_invocation(scene: Scene) -> None:
    action = scene.one.browser.root + "ur5/wrist_3_joint/actions/rotate"
    answer = scene.one.browser.http.post(action, json={"value": 3.0, "unit": RAD}, headers={"prefer": "respond-async"})
    assert answer.status_code == 202, answer.text
    scene.agent.send(signal.SIGKILL)
    scene.becomes("motion-failed", "confirmed")
    said = scene.faults()["motion-failed"]
    assert said["evidence"] == answer.headers["location"]
    assert said["count"] == 1


def test_a_robot_that_moves_by_itself_is_told_of_and_one_that_is_moved_is_not(scene: Scene) -> None:
    action = scene.one.browser.root + "ur5/wrist_3_joint/actions/rotate"
    for angle in (0.5, 0.0, 0.5, 0.0):
        answer = scene.one.browser.http.post(action, json={"value": angle, "unit": RAD}, headers={"prefer": "wait=20"})
        assert answer.is_success, answer.text

    def sways() -> bool:
        scene.hub.steps = 50 - scene.hub.steps
        scene.hub.repeat()
        return "uncommanded" in scene.faults()

    def told() -> bool:
        return sways() and scene.state("uncommanded") == "confirmed"

    eventually(told, lambda: f"the movement is told of: {scene.faults()}")
    said = scene.faults()
    assert set(said) == {"uncommanded"}
    assert said["uncommanded"]["about"] == scene.one.browser.root + "toy/"
    scene.becomes("uncommanded", "cleared")


def test_faults_outlive_the_gateway_that_writes_them(scene: Scene) -> None:
    scene.agent.send(signal.SIGKILL)
    scene.becomes("offline", "confirmed", scene.other)
    scene.one.process.send(signal.SIGKILL)
    with process("-m", "linked_fleet_agent", "--robot=ur5", "--connect", scene.hub.endpoint):
        scene.becomes("offline", "cleared", scene.other)


def test_a_rule_raises_a_fault_and_another_rule_sees_it(scene: Scene) -> None:
    root, http = scene.one.browser.root, scene.one.browser.http
    lf = "PREFIX lf: <https://w3id.org/linked-fleet#> "
    said = (
        "@prefix dcterms: <http://purl.org/dc/terms/> . @prefix lf: <https://w3id.org/linked-fleet#> . "
        f'<> dcterms:title "Tell" ; lf:condition "{lf}SELECT ?robot WHERE {{ ?f lf:about ?robot ; '
        f'lf:state lf:faultConfirmed ; lf:faultKind \\"told noise\\" }}" ; lf:invokes <{root}actions/raiseFault> ; '
        'lf:body [ lf:about [ lf:variable "robot" ] ; dcterms:title "By a rule." ; lf:faultKind "rule" ] .'
    )
    answer = http.post(root + "rules", content=said, headers={"content-type": "text/turtle"})
    assert answer.status_code == 201, answer.text
    rule = scene.one.browser.page(answer.headers["location"])
    eventually(lambda: scene.one.browser.page(rule.url).one(LF.state) != LF.starting, "evaluated")
    assert scene.raise_(faultKind="noise") == 204
    scene.becomes("told rule", "confirmed", scene.other)
    assert URIRef(root + "ur5/") == URIRef(scene.faults()["told rule"]["about"])
