"""Schedules at two gateways: one order at each start, whoever adds it, and missed starts that are said."""

import contextlib
import signal
import time
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import httpx
import pyshacl
import pytest
import rdflib

from browser import HYBRIT, LDP
from gateway_group import Gateway, gateways, hub
from linked_fleet_gateway.extensions.queue.order import Wanted
from linked_fleet_gateway.extensions.queue.recurrence import Recurrence
from linked_fleet_gateway.extensions.queue.schedule import KEPT, Missed, Planned, Schedule, with_missed
from linked_fleet_gateway.extensions.queue.timetable import AT_ONCE, advanced, first_start, order_id
from redis_servers import single
from running import eventually

pytestmark = pytest.mark.virtual
DAY_NS = 86_400 * 10**9


@dataclass
class Scene:
    one: Gateway
    other: Gateway

    def mission(self) -> str:
        said = {"title": "hello", "step": {"type": "notify", "text": "hello"}}
        return self.one.browser.http.post(self.one.browser.root + "missions", json=said).headers["location"]

    def post(self, rule: str, start: datetime, **more: Any) -> httpx.Response:
        said = {"rule": rule, "start": start.strftime("%Y-%m-%dT%H:%M:%S"), "timeZone": "UTC", **more}
        said = {"order": {"mission": self.mission()}} | said
        return self.one.browser.http.post(self.one.browser.root + "schedules", json=said)

    def every_minute(self, start: datetime, **more: Any) -> str:
        minutes = ",".join(map(str, range(60)))
        hours = ",".join(map(str, range(24)))
        answer = self.post(f"FREQ=DAILY;BYHOUR={hours};BYMINUTE={minutes}", start, **more)
        assert answer.status_code == 201, answer.text
        return answer.headers["location"]

    def told(self, iri: str, gateway: Gateway | None = None) -> dict[str, Any]:
        at = gateway or self.other
        answer = at.browser.http.get(at.here(iri), headers={"accept": "application/json"})
        found: dict[str, Any] = answer.json() if answer.status_code == 200 else {}
        return found

    def orders(self) -> list[dict[str, Any]]:
        page = self.other.browser.page(self.other.browser.root + "queue")
        return [self.told(str(each)) for each in page.graph.objects(None, LDP.contains)]


def now() -> datetime:
    return datetime.fromtimestamp(time.time(), UTC)


@pytest.fixture
def scene(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Scene]:
    with single(tmp_path_factory.mktemp("redis")) as memory, hub() as centre, contextlib.ExitStack() as stack:
        one, other = stack.enter_context(gateways(centre, memory.url))
        yield Scene(one, other)


def wait(seconds: float) -> None:
    until_s = time.monotonic() + seconds
    eventually(lambda: time.monotonic() >= until_s, "the time")


def test_each_start_puts_one_order_into_the_queue(scene: Scene) -> None:
    iri = scene.every_minute(now(), title="regularly")
    for _ in range(3):
        wait(60)
    eventually(lambda: len(scene.orders()) >= 3, lambda: str(scene.orders()))
    orders = scene.orders()
    assert len(orders) == 3
    assert {each["title"] for each in orders} == {"regularly"}
    assert {each["schedule"][-36:] for each in orders} == {iri[-36:]}
    eventually(lambda: {each["state"] for each in scene.orders()} == {"succeeded"}, "all of them")
    assert scene.told(iri)["missedStarts"] == 0
    assert scene.told(iri)["lastOrder"][-36:] in str(scene.one.get(scene.one.browser.root + "queue").text)


def test_a_gateway_that_is_killed_at_a_start_loses_and_doubles_none(scene: Scene) -> None:
    scene.every_minute(now())
    due_s = 60 - time.time() % 60
    wait(due_s - 0.02)
    scene.one.process.send(signal.SIGKILL)
    wait(30)
    assert len(scene.orders()) == 1


def test_missed_starts_are_said_and_not_made_up(scene: Scene) -> None:
    iri = scene.every_minute(now())
    for each in (scene.one, scene.other):
        each.process.send(signal.SIGSTOP)
    for _ in range(6):
        wait(60)
    for each in (scene.one, scene.other):
        each.process.send(signal.SIGCONT)
    eventually(lambda: scene.told(iri).get("missedStarts", 0) >= 4, lambda: str(scene.told(iri)))
    missed = scene.told(iri)["missed"]
    assert len({each["at"] for each in missed}) == len(missed) == scene.told(iri)["missedStarts"]
    assert "no gateway was there" in missed[0]["reason"]
    assert len(scene.orders()) <= 2


def test_a_schedule_that_cannot_order_says_why(scene: Scene) -> None:
    iri = scene.every_minute(now())
    mission = scene.told(iri, scene.one)["order"]["mission"]
    assert scene.one.browser.http.delete(mission).status_code == 204
    wait(60)
    eventually(lambda: scene.told(iri)["missedStarts"] == 1, lambda: str(scene.told(iri)))
    assert "no action" in scene.told(iri)["missed"][0]["reason"]
    assert scene.orders() == []


def test_an_inactive_schedule_orders_nothing_and_goes_on(scene: Scene) -> None:
    iri = scene.every_minute(now(), active=False)
    assert "next" not in scene.told(iri, scene.one) or not scene.told(iri, scene.one)["next"]
    wait(60)
    wait(30)
    assert scene.orders() == [] and scene.told(iri)["missedStarts"] == 0
    http = scene.one.browser.http
    written = {key: scene.told(iri)[key] for key in ("order", "rule", "start", "timeZone", "title")}
    assert http.put(iri, json=written | {"active": True}).status_code == 204
    wait(60)
    eventually(lambda: len(scene.orders()) == 1, lambda: str(scene.told(iri)))
    assert http.delete(iri).status_code == 204
    wait(60)
    wait(20)
    assert len(scene.orders()) == 1


def test_wrong_schedules_are_refused_with_what_is_right(scene: Scene) -> None:
    later = now().strftime("%Y-%m-%dT%H:%M:%S")
    order = {"mission": scene.mission()}
    cases: list[tuple[dict[str, Any], str]] = [
        ({"rule": "FREQ=SECONDLY"}, "BYHOUR and BYMINUTE"),
        ({"rule": "FREQ=DAILY;BYMONTH=2;BYMONTHDAY=30"}, "no start"),
        ({"rule": "FREQ=DAILY;UNTIL=20200101"}, "no start"),
        ({"timeZone": "Nowhere"}, "time zone"),
        ({"start": "now"}, "local time"),
        ({"start": "1990-01-01T00:00:00"}, "starts in the past"),
        ({"order": {"mission": scene.one.browser.root + "missions/none"}}, "no action"),
        ({"order": order | {"deadline": "2099-01-01T00:00:00Z"}}, "within"),
        ({"within": -1}, "within"),
    ]
    for more, words in cases:
        said = {"rule": "FREQ=DAILY", "start": later, "timeZone": "UTC", "order": order} | more
        answer = scene.one.browser.http.post(scene.one.browser.root + "schedules", json=said)
        assert answer.status_code == 422, (more, answer.text)
        assert words in answer.json()["detail"], (more, answer.json()["detail"])


def test_schedules_conform_to_their_blueprints_and_survive_as_turtle(scene: Scene) -> None:
    iri = scene.every_minute(now(), within=30)
    root = scene.one.browser.root
    for url in (iri, root + "schedules"):
        graph = scene.one.browser.page(url).graph
        (blueprint,) = {str(each) for each in graph.objects(rdflib.URIRef(url), HYBRIT.blueprint)}
        conforms, _, text = pyshacl.validate(
            graph, shacl_graph=scene.one.browser.page(blueprint).graph, inference="none"
        )
        assert conforms, text
    before = scene.told(iri, scene.one)
    answer = scene.one.browser.http.get(iri, headers={"accept": "text/turtle"})
    fields = {"content-type": "text/turtle", "if-match": answer.headers["etag"]}
    assert scene.one.browser.http.put(iri, content=answer.text, headers=fields).status_code == 204
    assert scene.told(iri, scene.one) == before
    wait(60)
    eventually(lambda: len(scene.orders()) == 1, "an order")
    assert "deadline" in scene.orders()[0]


# -- pure -------------------------------------------------------------------------------------------------------------


def planned(rule: str = "FREQ=DAILY") -> Schedule:
    return Schedule(Planned(Wanted("http://a/missions/m"), rule, "2026-12-01T09:00:00", "UTC"))


def at(text: str) -> int:
    recurrence = Recurrence("FREQ=DAILY", text, "UTC")
    return recurrence.instant_ns(next(recurrence.after(None)))


def test_the_first_start_is_not_past_and_a_count_has_past_ones() -> None:
    begun = first_start(planned(), at("2026-12-03T10:00:00"))
    assert begun is not None and (begun.next, begun.done) == ("2026-12-04T09:00:00", 3)
    over = first_start(planned("FREQ=DAILY;COUNT=3"), at("2026-12-03T10:00:00"))
    assert over is not None and over.next == ""
    assert first_start(planned(), at("2036-12-03T10:00:00")) is None


def test_it_goes_on_with_the_start_after_those_that_are_due() -> None:
    begun = first_start(planned("FREQ=DAILY;COUNT=4"), at("2026-12-01T09:00:00"))
    assert begun is not None and begun.next == "2026-12-01T09:00:00"
    after, due = advanced(begun, at("2026-12-02T09:00:00"))
    assert (after.next, after.done, len(due)) == ("2026-12-03T09:00:00", 2, 2)
    over, rest = advanced(after, at("2027-12-03T10:00:00"))
    assert (over.next, over.done, len(rest)) == ("", 4, 2)
    assert due[1] - due[0] == rest[1] - rest[0] == DAY_NS


def test_a_long_time_without_gateways_is_gone_through_in_parts() -> None:
    begun = first_start(planned(), at("2026-12-01T09:00:00"))
    assert begun is not None
    after, due = advanced(begun, at("2036-12-01T10:00:00"))
    assert len(due) == AT_ONCE and after.next == "2029-08-27T09:00:00"


def test_the_latest_missed_starts_are_kept_and_all_are_counted() -> None:
    many = [Missed(number, "away") for number in range(50)]
    schedule = with_missed(planned(), many)
    assert (schedule.missed_count, schedule.missed) == (50, tuple(many[-KEPT:]))


def test_the_id_of_an_order_is_that_of_schedule_and_start() -> None:
    assert order_id("a", 1) == order_id("a", 1)
    assert len({order_id("a", 1), order_id("a", 2), order_id("b", 1)}) == 3
