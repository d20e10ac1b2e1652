"""What robots say about their components: malformed, oversized, lost, late and stale messages, and new runs."""

import itertools
import time
from collections.abc import Callable, Iterator
from typing import Any

import msgspec
import pytest
import zenoh
from msgspec import Raw
from msgspec.structs import asdict

from browser import LF, Browser, Page
from fake_robots import KEYS, FakeRobot, open_session
from linked_fleet_agent.wire.codec import decode, encode
from linked_fleet_agent.wire.components import (
    COMPONENTS_VERSION,
    DescriptionWithComponents,
    Measured,
    Occurrence,
    Values,
)
from linked_fleet_agent.wire.messages import Description
from running import eventually
from small_fleet import Place

pytestmark = pytest.mark.virtual
LAMP = {
    "name": "lamp",
    "stale_s": 1.0,
    "properties": {"on": {"schema": {"type": "boolean"}}, "heat": {"schema": {"type": "number", "maximum": 100}}},
    "events": {"blown": {"data": {"type": "string", "maxLength": 5}}},
}


class Talker:
    """A robot that says about its components what the test says."""

    def __init__(self, session: zenoh.Session, browser: Browser, declared: Any = (LAMP,), name: str = "talker") -> None:
        self.actor, self.browser = FakeRobot(session, name), browser
        self.sequence, self.asked = itertools.count(1), 0
        self.everything: dict[str, Any] = {"on": False, "heat": 20.0}
        self.key = KEYS.robot(name, "values")
        self._kept = session.declare_queryable(self.key, self._answer)
        said = decode(self.actor.description(), Description)
        declarations = declared if isinstance(declared, bytes) else msgspec.json.encode(declared)
        self.actor.appear(encode(DescriptionWithComponents(**asdict(said), components=Raw(declarations))))
        self.actor.stand(0.0)

    def _answer(self, query: zenoh.Query) -> None:
        self.asked += 1
        query.reply(self.key, self.values(self.everything, next(self.sequence) - 1))
        self.sequence = itertools.count(self.last + 1)

    def values(self, values: dict[str, Any], sequence: int | None = None, at_ns: int | None = None) -> bytes:
        self.last = next(self.sequence) if sequence is None else sequence
        now_ns = time.monotonic_ns()
        raw = {name: Raw(msgspec.json.encode(value)) for name, value in values.items()}
        measured = Measured(at_ns=now_ns if at_ns is None else at_ns, values=raw)
        return encode(
            Values(
                version=COMPONENTS_VERSION,
                incarnation=self.actor.incarnation,
                sequence=self.last,
                monotonic_ns=now_ns,
                wall_ns=time.time_ns(),
                components={"lamp": measured},
            )
        )

    def say(self, **values: Any) -> None:
        self.actor.put("values", self.values(values))

    def happen(self, data: bytes | None, event: str = "blown") -> None:
        said = Occurrence(
            version=COMPONENTS_VERSION, incarnation=self.actor.incarnation, sequence=next(self.sequence),
            monotonic_ns=time.monotonic_ns(), wall_ns=time.time_ns(), component="lamp", event=event,
            **({} if data is None else {"data": Raw(data)}),
        )  # fmt: skip
        self.actor.put("event", encode(said))

    def json(self, path: str = "lamp") -> Any:
        answer = self.browser.http.get(f"{self.browser.root}talker/{path}", headers={"accept": "application/json"})
        return answer.json() if answer.status_code == 200 else None

    def until(self, wanted: Any, path: str = "lamp") -> None:
        eventually(lambda: self.json(path) == wanted, f"{path} is {wanted}")

    def page(self) -> Page:
        return self.browser.robot("talker")

    def malformed(self) -> float:
        lines = self.browser.http.get(self.browser.root + "metrics").text.splitlines()
        (found,) = [line for line in lines if "messages_malformed_total " in line and not line.startswith("#")]
        return float(found.rpartition(" ")[2])


@pytest.fixture
def talk(tmp_path: Any) -> Iterator[Callable[..., Talker]]:
    place = Place(tmp_path)
    with place.gateway() as (_, browser), open_session(place.zenoh) as session:

        def begin(declared: Any = (LAMP,)) -> Talker:
            return Talker(session, browser, declared)

        yield begin


def test_a_gateway_that_is_new_asks_for_all_values_and_then_follows_the_changes(talk: Callable[..., Talker]) -> None:
    talker = talk()
    talker.until({"on": False, "heat": 20.0})
    talker.say(heat=21.5)
    talker.until({"on": False, "heat": 21.5})
    assert talker.asked == 1


def test_values_that_were_missed_are_asked_for(talk: Callable[..., Talker]) -> None:
    talker = talk()
    talker.until({"on": False, "heat": 20.0})
    talker.values({"on": True})  # lost
    talker.everything["on"] = True
    talker.say(heat=22.0)
    talker.everything["heat"] = 22.0
    talker.until({"on": True, "heat": 22.0})
    assert talker.asked == 2


def test_a_late_message_and_one_of_another_run_change_nothing(talk: Callable[..., Talker]) -> None:
    talker = talk()
    talker.until({"on": False, "heat": 20.0})
    late = talker.values({"heat": 1.0})
    talker.say(heat=2.0)
    talker.everything["heat"] = 2.0
    talker.until({"on": False, "heat": 2.0})
    talker.actor.put("values", late)
    talker.actor.incarnation += 1
    talker.say(heat=3.0)
    talker.actor.incarnation -= 1
    talker.say(on=True)
    talker.everything["on"] = True
    talker.until({"on": True, "heat": 2.0})


@pytest.mark.parametrize(
    "spoil",
    [
        lambda talker: talker.actor.put("values", b"{"),
        lambda talker: talker.actor.put("values", b"[" * 100_000),
        lambda talker: talker.actor.put("values", b" " * 400_000),
        lambda talker: talker.say(heat="hot"),
        lambda talker: talker.say(heat=101),
        lambda talker: talker.say(nothing=1),
        lambda talker: talker.actor.put("event", b"{}"),
        lambda talker: talker.happen(b'"too long"'),
        lambda talker: talker.happen(b'"x"', event="none"),
    ],
    ids=[
        "no JSON",
        "deep",
        "long",
        "another type",
        "out of range",
        "undeclared",
        "no event",
        "event",
        "unknown event",
    ],
)
def test_what_is_not_declared_is_counted_and_the_rest_goes_on(
    talk: Callable[..., Talker], spoil: Callable[[Talker], None]
) -> None:
    talker = talk()
    talker.until({"on": False, "heat": 20.0})
    spoil(talker)
    eventually(lambda: talker.malformed() == 1, "the message is counted")
    talker.say(on=True)
    talker.everything = {"on": True, "heat": talker.everything["heat"]}
    eventually(lambda: talker.json()["on"] is True, "the next message counts")
    assert talker.json()["heat"] in (20.0, None)
    assert talker.page().one(LF.presence) == LF.online


def test_values_are_unknown_when_nothing_is_heard_for_too_long(talk: Callable[..., Talker]) -> None:
    talker = talk()
    talker.until({"on": False, "heat": 20.0})
    talker.until({"on": None, "heat": None})
    talker.say(on=False)
    eventually(lambda: talker.json()["on"] is False, "it is heard again")


def test_an_event_is_counted_and_has_its_data(talk: Callable[..., Talker]) -> None:
    talker = talk()
    talker.until({"on": False, "heat": 20.0})
    assert talker.json("lamp/blown") == {"occurrences": 0, "resultTime": None}
    talker.happen(b'"left"')
    eventually(lambda: talker.json("lamp/blown")["occurrences"] == 1, "the event")
    assert talker.json("lamp/blown")["value"] == "left"


@pytest.mark.parametrize(
    ("declared", "said"),
    [
        ([LAMP, {"name": "bad", "properties": {"x": {"schema": {"type": "date"}}}}], "component 2 is refused"),
        ([LAMP, LAMP], "another component has this name"),
        ([LAMP, {"name": "far", "link": "moon"}], "its link 'moon' is none of the robot's"),
        ([LAMP, 3], "component 2 is refused"),
    ],
)
def test_a_bad_component_costs_no_other_and_the_robot_says_why(
    talk: Callable[..., Talker], declared: Any, said: str
) -> None:
    talker = talk(declared)
    talker.until({"on": False, "heat": 20.0})
    findings = [str(each) for each in talker.page().graph.objects(talker.page().iri, LF.finding)]
    assert any(said in each for each in findings), findings
    assert talker.malformed() == 1
    assert talker.page().one(LF.presence) == LF.online


@pytest.mark.parametrize("declared", [b"{}", b"null", b"[" + b" " * 300_000 + b"]"])
def test_declarations_that_are_none_cost_no_joints(talk: Callable[..., Talker], declared: bytes) -> None:
    talker = talk(declared)
    eventually(lambda: talker.malformed() == 1, "it is counted")
    page = talker.page()
    assert page.one(LF.presence) == LF.online
    assert "the components are refused" in str(page.one(LF.finding))
    assert talker.json() is None


def test_a_name_that_a_joint_has_too_gets_a_mark(talk: Callable[..., Talker]) -> None:
    talker = talk([LAMP, {**LAMP, "name": "elbow"}, {**LAMP, "name": "actions"}])
    talker.until({"on": False, "heat": 20.0})
    assert talker.json("elbow~part") is not None
    assert talker.json("~61ctions") is not None
