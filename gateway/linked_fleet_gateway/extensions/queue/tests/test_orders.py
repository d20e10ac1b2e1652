"""Orders at two gateways with one Redis: their turn, robots, deadlines, and what clients do with them."""

import contextlib
import time
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import httpx
import pyshacl
import pytest
import rdflib

from browser import HYBRIT, LDP, LF, SH
from commanding import control
from gateway_group import Gateway, gateways, hub
from redis_servers import single
from running import Process, eventually, process
from small_fleet import live, offline

pytestmark = pytest.mark.virtual
RAD = "http://qudt.org/vocab/unit/RAD"
ROBOTS = ("a", "b")


@dataclass
class Scene:
    """Two gateways, and robots that missions turn."""

    one: Gateway
    other: Gateway
    agents: dict[str, Process]

    def mission(self, *steps: dict[str, Any], **more: Any) -> str:
        said = {"title": "a mission", "step": {"type": "sequence", "steps": list(steps)}, **more}
        answer = self.one.browser.http.post(self.one.browser.root + "missions", json=said)
        assert answer.status_code == 201, answer.text
        return answer.headers["location"]

    def turn(self, robot: str, angle: float = 0.1) -> dict[str, Any]:
        action = f"{self.one.browser.root}{robot}/wrist_3_joint/actions/rotate"
        return {"type": "invoke", "action": action, "body": {"value": angle, "unit": RAD}}

    def any(self) -> str:
        """Post a mission that halts any robot, and return its IRI."""
        step = {"type": "invoke", "kind": f"{LF}StopRobot", "of": {"variable": "robot"}}
        return self.mission({"type": "wait", "seconds": 5}, step, parameters=[{"name": "robot", "type": "iri"}])

    def post(self, mission: str, **more: Any) -> httpx.Response:
        return self.one.browser.http.post(self.one.browser.root + "queue", json={"mission": mission, **more})

    def order(self, mission: str, **more: Any) -> "Posted":
        answer = self.post(mission, **more)
        assert answer.status_code == 201, answer.text
        return Posted(self, answer.headers["location"])

    def service(self, robot: str, in_service: bool, reason: str = "worn") -> None:
        url = f"{self.one.browser.root}{robot}/availability"
        said = {"inService": in_service} | ({} if in_service else {"reason": reason})
        assert self.one.browser.http.put(url, json=said).status_code == 204


@dataclass
class Posted:
    """An order, as seen at one of the gateways."""

    scene: Scene
    iri: str

    def told(self, gateway: Gateway | None = None) -> dict[str, Any]:
        at = gateway or self.scene.one
        answer = at.browser.http.get(at.here(self.iri), headers={"accept": "application/json"})
        assert answer.status_code == 200, answer.text
        found: dict[str, Any] = answer.json()
        return found

    def state(self, gateway: Gateway | None = None) -> str:
        return str(self.told(gateway)["state"])

    def comes_to(self, state: str, gateway: Gateway | None = None) -> dict[str, Any]:
        eventually(lambda: self.state(gateway) == state, lambda: f"{state}, not {self.told(gateway)}")
        return self.told(gateway)

    def waits(self, reason: str) -> None:
        eventually(lambda: reason in self.told().get("reason", ""), lambda: f"{reason!r}, not {self.told()}")
        assert self.state() == "waiting"

    def do(self, action: str, **body: str) -> httpx.Response:
        http, url = self.scene.one.browser.http, f"{self.iri}/actions/{action}"
        return http.post(url, json=body) if body else http.post(url)

    def page(self) -> rdflib.Graph:
        return self.scene.one.browser.page(self.iri).graph


@pytest.fixture
def scene(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Scene]:
    with single(tmp_path_factory.mktemp("redis")) as memory, hub() as centre, contextlib.ExitStack() as stack:
        agents = {
            name: stack.enter_context(
                process("-m", "linked_fleet_agent", f"--robot={name}=ur5", "--connect", centre.endpoint)
            )
            for name in ROBOTS
        }
        one, other = stack.enter_context(gateways(centre, memory.url))
        for gateway in (one, other):
            for name in ROBOTS:
                live(gateway.browser, name)
        yield Scene(one, other, agents)


def test_an_order_runs_and_shows_its_run_at_all_gateways(scene: Scene) -> None:
    order = scene.order(scene.mission(scene.turn("a"), title="Turn"))
    told = order.comes_to("succeeded", scene.other)
    assert (told["title"], told["attempt"], told["mission"][-9:]) == ("Turn", 1, order.told()["mission"][-9:])
    assert told["robots"] == [f"{scene.one.browser.root}a/"]
    run = scene.one.browser.http.get(told["run"], headers={"accept": "application/json"}).json()
    assert run["state"] == "succeeded"


def test_a_mission_without_robots_runs_at_once(scene: Scene) -> None:
    scene.order(scene.mission({"type": "notify", "text": "hello"})).comes_to("succeeded")


def test_a_robot_has_one_order_at_a_time_and_others_have_theirs(scene: Scene) -> None:
    slow = scene.mission({"type": "wait", "seconds": 20}, scene.turn("a"))
    first, second = scene.order(slow), scene.order(slow)
    free = scene.order(scene.mission(scene.turn("b")))
    first.comes_to("running")
    second.waits("waits for a, which has another order")
    free.comes_to("succeeded")
    assert first.state() == "running"
    first.comes_to("succeeded")
    second.comes_to("succeeded")
    begun, ended = second.told()["started"], first.told()["ended"]
    assert begun >= ended


def test_any_robot_that_can_takes_an_order(scene: Scene) -> None:
    root, mission = scene.one.browser.root, scene.any()
    base = {"parameter": "robot"}
    listed = scene.order(mission, choice=base | {"robots": [f"{root}b/"]})
    by_kind = scene.order(mission, choice=base | {"offers": f"{LF}MoveJoints"})
    assert listed.comes_to("succeeded")["robots"] == [f"{root}b/"]
    assert by_kind.comes_to("succeeded")["robots"] == [f"{root}a/"]
    query = f"SELECT ?robot {{ ?robot a <{LF}Robot> . FILTER(STRENDS(STR(?robot), '/b/')) }}"
    selected = scene.order(mission, choice=base | {"select": query})
    assert selected.comes_to("succeeded")["robots"] == [f"{root}b/"]
    scene.service("b", False)
    other = scene.order(mission, choice=base | {"select": query})
    other.waits("no robot that can is free: b, which is out of service: worn")
    nobody = scene.order(mission, choice=base | {"kind": f"{LF}Base"})
    nobody.waits("no robot can: none fits")


def test_wrong_orders_are_refused_with_what_is_right(scene: Scene) -> None:
    turn = scene.mission(scene.turn("a"))
    some = scene.any()
    root = scene.one.browser.root
    cases: list[tuple[dict[str, Any], str]] = [
        ({"mission": f"{root}missions/none"}, "no action"),
        ({"mission": f"{root}a/"}, "members of /missions"),
        ({"mission": "http://elsewhere.example/missions/1"}, "members of /missions"),
        ({"mission": "no IRI"}, "no IRI"),
        ({"mission": turn, "input": {"x": 1}}, "has none"),
        ({"mission": turn, "priority": 101}, "100"),
        ({"mission": turn, "deadline": "tomorrow"}, "xsd:dateTime"),
        ({"mission": turn, "deadline": "2026-01-01T00:00:00"}, "time zone"),
        ({"mission": turn, "deadline": "2026-01-01T00:00:00Z"}, "has passed"),
        ({"mission": turn, "battery": 101}, "100"),
        ({"mission": turn, "wrong": 1}, "wrong"),
        ({"mission": some}, "robot"),
        ({"mission": some, "choice": {"parameter": "robot"}}, "which robots can"),
        ({"mission": some, "choice": {"parameter": "x", "kind": f"{LF}Base"}}, "no parameter x"),
        ({"mission": some, "choice": {"parameter": "robot", "robots": [f"{root}nobody/"]}}, "no robot"),
        ({"mission": some, "choice": {"parameter": "robot", "select": "ASK {}"}}, "query"),
    ]
    for said, words in cases:
        answer = scene.one.browser.http.post(root + "queue", json=said)
        assert answer.status_code == 422, (said, answer.text)
        assert words in answer.json()["detail"], (said, answer.json()["detail"])
    assert "[" not in "".join(
        str(each) for each in scene.one.browser.page(root + "queue").graph.objects(None, LDP.contains)
    )


def test_a_deadline_that_passes_is_said(scene: Scene) -> None:
    slow = scene.order(scene.mission({"type": "wait", "seconds": 60}, scene.turn("a")))
    slow.comes_to("running")
    soon = datetime.fromtimestamp(time.time() + 10, UTC).isoformat()
    late = scene.order(scene.mission(scene.turn("a")), deadline=soon)
    told = late.comes_to("missed")
    assert "deadline" in told["reason"] and "a, which has another order" in told["reason"]
    assert "run" not in told


def test_a_higher_priority_comes_first(scene: Scene) -> None:
    slow = scene.order(scene.mission({"type": "wait", "seconds": 10}, scene.turn("a")))
    slow.comes_to("running")
    turn = scene.mission(scene.turn("a"))
    later, urgent = scene.order(turn), scene.order(turn, priority=7)
    later.comes_to("succeeded")
    assert urgent.told()["started"] < later.told()["started"]


def test_orders_are_moved_while_they_wait(scene: Scene) -> None:
    slow = scene.order(scene.mission({"type": "wait", "seconds": 15}, scene.turn("a")))
    slow.comes_to("running")
    turn = scene.mission(scene.turn("a"))
    first, second, third = (scene.order(turn) for _ in range(3))
    urgent = scene.order(turn, priority=1)
    assert third.do("move", before=first.iri).status_code == 204
    assert first.do("move", after=second.iri).status_code == 204
    ranks = [each.told()["rank"] for each in (third, second, first)]
    assert ranks == sorted(ranks)
    assert first.do("move", before=urgent.iri).status_code == 409
    assert first.do("move", before=slow.iri).status_code == 409
    assert first.do("move", before=first.iri).status_code == 422
    assert first.do("move", before=scene.one.browser.root + "a/").status_code == 422
    assert first.do("move", before=second.iri, after=third.iri).status_code == 422
    first.comes_to("succeeded")
    begun = [each.told()["started"] for each in (urgent, third, second, first)]
    assert begun == sorted(begun)


def test_an_order_is_changed_withdrawn_and_deleted_while_it_waits(scene: Scene) -> None:
    slow = scene.order(scene.mission({"type": "wait", "seconds": 600}, scene.turn("a")))
    slow.comes_to("running")
    turn = scene.mission(scene.turn("a"))
    one, other = scene.order(turn), scene.order(turn)
    http = scene.one.browser.http
    assert http.put(one.iri, json={"mission": turn, "priority": 3, "title": "renamed"}).status_code == 204
    assert (one.told()["priority"], one.told()["title"]) == (3, "renamed")
    assert one.do("withdraw").status_code == 204
    assert one.comes_to("cancelled")["reason"].startswith("withdrawn")
    assert one.do("withdraw").status_code == 409
    assert http.put(one.iri, json={"mission": turn}).status_code == 409
    for each in (one, other):
        assert http.delete(each.iri).status_code == 204
        assert http.get(each.iri).status_code == 404
    assert http.delete(slow.iri).status_code == 409
    assert slow.do("withdraw").status_code == 204
    told = slow.comes_to("cancelled", scene.other)
    assert "withdrawn" in told["reason"]
    run = http.get(told["run"], headers={"accept": "application/json"}).json()
    assert run["state"] == "cancelled"
    scene.order(turn).comes_to("succeeded")


def test_an_order_goes_back_when_its_robot_is_taken_out_of_service(scene: Scene) -> None:
    order = scene.order(scene.mission({"type": "wait", "seconds": 5}, scene.turn("a")))
    order.comes_to("running")
    behind = scene.order(scene.mission(scene.turn("a")))
    scene.service("a", False, "gearbox")
    order.waits("waits for a, which is out of service: gearbox")
    assert order.told()["notes"] == ["attempt 1: a was taken out of service"]
    behind.waits("gearbox")
    direct = f"{scene.one.browser.root}a/wrist_3_joint/actions/rotate"
    moved = scene.one.browser.http.post(direct, json={"value": 0.05, "unit": RAD}, headers={"prefer": "wait=10"})
    assert moved.status_code == 204, "direct commands of people still work"
    scene.service("a", True)
    assert order.comes_to("succeeded")["attempt"] == 2
    assert behind.comes_to("succeeded")["started"] > order.told()["started"]


def test_an_order_waits_for_an_offline_robot_and_a_lease(scene: Scene) -> None:
    turn = scene.mission(scene.turn("a"))
    scene.agents["a"].stop()
    for gateway in (scene.one, scene.other):
        offline(gateway.browser, "a")
    order = scene.order(turn)
    order.waits("a, which is offline")
    url, fields = f"{scene.one.browser.root}b/lease", {"content-type": "text/turtle"}
    assert scene.one.browser.http.put(url, content=control("ann", 20), headers=fields).status_code == 204
    held = scene.order(scene.mission(scene.turn("b")))
    held.waits("b, which is controlled by")
    held.comes_to("succeeded")


def test_a_stop_ends_an_order_and_nothing_begins_again(scene: Scene) -> None:
    order = scene.order(scene.mission({"type": "wait", "seconds": 60}, scene.turn("a")))
    order.comes_to("running")
    assert scene.one.browser.http.post(f"{scene.one.browser.root}a/actions/stop").status_code in (201, 204)
    told = order.comes_to("failed")
    assert "stopped by a client" in told["reason"] and told["attempt"] == 1


def test_orders_conform_to_their_blueprints_and_survive_as_turtle(scene: Scene) -> None:
    root = scene.one.browser.root
    choice = {"parameter": "robot", "kind": f"{LF}Base", "near": {"x": 1, "y": 2}}
    deadline = "2099-01-01T00:00:00Z"
    order = scene.order(scene.any(), choice=choice, battery=20, deadline=deadline, priority=-2)
    order.waits("no robot can")
    for url in (order.iri, root + "queue"):
        graph = scene.one.browser.page(url).graph
        (blueprint,) = {str(each) for each in graph.objects(rdflib.URIRef(url), HYBRIT.blueprint)}
        shapes = scene.one.browser.page(blueprint).graph
        assert (None, SH.targetNode, rdflib.URIRef(url)) in shapes
        conforms, _, text = pyshacl.validate(graph, shacl_graph=shapes, inference="none")
        assert conforms, text
    before = order.told()
    answer = scene.one.browser.http.get(order.iri, headers={"accept": "text/turtle"})
    fields = {"content-type": "text/turtle", "if-match": answer.headers["etag"]}
    assert scene.one.browser.http.put(order.iri, content=answer.text, headers=fields).status_code == 204
    assert order.told() == before
    other = scene.other.browser.http.get(scene.other.here(order.iri), headers={"accept": "text/turtle"})
    assert other.text.count("lf:rank") == answer.text.count("lf:rank")


def test_the_page_lists_the_orders_in_their_turn_and_why_they_wait(scene: Scene) -> None:
    slow = scene.order(scene.mission({"type": "wait", "seconds": 60}, scene.turn("a")), title="slow")
    slow.comes_to("running")
    turn = scene.mission(scene.turn("a"))
    for title, priority in (("later", 0), ("urgent", 2)):
        scene.order(turn, title=title, priority=priority).waits("another order")
    page = scene.one.browser.http.get(scene.one.browser.root + "queue", headers={"accept": "text/html"}).text
    rows = [each.partition("</tr>")[0] for each in page.split("<tr data-order=")[1:]]
    assert [("urgent" in each, "later" in each) for each in rows] == [(True, False), (False, True)]
    assert "waits for a, which has another order" in rows[0]
    assert page.index("slow") < page.index("<tr data-order=")
    for path in (slow.iri, scene.one.browser.root + "schedules"):
        assert scene.one.browser.http.get(path, headers={"accept": "text/html"}).status_code == 200
