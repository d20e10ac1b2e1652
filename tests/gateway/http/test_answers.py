"""Cached responses to GET are valid as long as only frames are new, for the caller for whom they were made."""

import gzip
from typing import Any, cast

import pytest

from linked_fleet_gateway.http.answers import CachedResponse, ResponseCache
from linked_fleet_gateway.http.arrival import Authenticated, arrival_of
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.versioning import Source
from linked_fleet_gateway.subscriptions.live import Live
from linked_fleet_identity.rights import Grant, Identity, Right
from linked_fleet_rdf.templates import Document, Template
from linked_fleet_state.robot import Robot

_FIELDS = ((b"vary", b"Accept"),)


class Stage:
    """A fleet of one robot, whose resource has ``facts``."""

    def __init__(self) -> None:
        self.robot = cast(Any, Robot)("r", lambda *_: None, None)
        self.facts: object = 1
        self.live = cast(Live, cast(Any, type("Stub", (), {}))())
        cast(Any, self.live).fleet = type("Stub", (), {"robots": {"r": self.robot}})()
        self.answers = ResponseCache(max_entries=3, max_bytes=100)

    def keep(self, content: bytes, **named: Any) -> None:
        resource = Resource("/r/a", "a", None, source=Source(lambda: self.facts, robot=self.robot))
        self.answers.store(scope(**named), CachedResponse(resource, self.robot, Document(content), _FIELDS, ()))

    def content(self, **named: Any) -> bytes | None:
        found = self.answers.find(scope(**named), self.live)
        return None if found is None else found.content


def scope(
    path: bytes = b"/r/a", method: str = "GET", query: bytes = b"", caller: Identity | None = None, **fields: str
) -> dict[str, Any]:
    headers = [(name.replace("_", "-").encode(), value.encode()) for name, value in fields.items()]
    found: dict[str, Any] = {"method": method, "raw_path": path, "query_string": query, "headers": headers}
    arrival = arrival_of(found)
    arrival.base = "http://fleet.example"
    if caller is not None:
        arrival.authenticated = Authenticated(caller)
    return found


@pytest.fixture
def stage() -> Stage:
    return Stage()


def test_constant_documents_stay_valid(stage: Stage) -> None:
    """A document that never changes belongs to no robot."""
    lasting = Resource("/vocabulary", "Vocabulary", None, source=Source(shown=tuple))
    stage.answers.store(scope(b"/vocabulary"), CachedResponse(lasting, None, Document(b"terms"), _FIELDS, ()))
    stage.robot.count_change()
    assert stage.content(path=b"/vocabulary") == b"terms"


def test_unrelated_request_fields_do_not_invalidate_an_answer(stage: Stage) -> None:
    stage.keep(b"one", accept="text/turtle")
    assert stage.content(accept="text/turtle", traceparent="00-1", user_agent="x") == b"one"
    assert stage.content(accept="text/turtle", method="HEAD") == b"one"


@pytest.mark.parametrize(
    "other",
    [
        {"path": b"/r/b"}, {"path": b"/r%2Fa"}, {"query": b"as=turtle"}, {"method": "POST"}, {"accept": "text/html"},
        {"accept": "text/turtle", "prefer": "return=minimal"}, {"accept": "text/turtle", "if_match": '"x"'},
        {"accept": "text/turtle", "upgrade": "callback"},
    ],
)  # fmt: skip
def test_requests_for_something_else_are_not_answered(stage: Stage, other: dict[str, Any]) -> None:
    stage.keep(b"one", accept="text/turtle")
    assert stage.content(**{"accept": "text/turtle", **other}) is None


def test_streams_are_never_kept(stage: Stage) -> None:
    stage.keep(b"one", accept="text/event-stream, text/turtle")
    assert len(stage.answers) == 0


def test_a_kept_answer_ends_with_other_facts_of_the_robot(stage: Stage) -> None:
    stage.keep(b"one")
    stage.facts = 2
    assert stage.content() is None
    stage.keep(b"two")
    assert stage.content() == b"two"
    stage.robot.count_change()
    assert stage.content() is None


def test_a_robot_of_the_same_name_is_another(stage: Stage) -> None:
    stage.keep(b"one")
    cast(Any, stage.live).fleet.robots["r"] = cast(Any, Robot)("r", lambda *_: None, None)
    assert stage.content() is None


def test_an_answer_is_kept_per_view(stage: Stage) -> None:
    one, other = (Identity(name, (Grant(frozenset({Right.READ}), (name,)),)) for name in ("r", "q"))
    stage.keep(b"one", caller=one)
    assert stage.content(caller=other) is None
    assert stage.content() is None
    assert stage.content(caller=one) == b"one"


def test_a_client_with_the_entity_tag_gets_304(stage: Stage) -> None:
    stage.keep(b"one")
    found = stage.answers.find(scope(), stage.live)
    assert found is not None
    tag = dict(found.fields)[b"etag"].decode()
    for known in (tag, f'"x", W/{tag}', "*"):
        again = stage.answers.find(scope(if_none_match=known), stage.live)
        assert again is not None and (again.status, again.content) == (304, b"")
        assert dict(again.fields) == {b"etag": tag.encode(), b"vary": b"Accept"}


def test_there_are_never_too_many_nor_too_much(stage: Stage) -> None:
    for number in range(5):
        stage.keep(b"x", path=b"/r/%d" % number)
    assert len(stage.answers) == 3
    assert stage.content(path=b"/r/1") is None and stage.content(path=b"/r/4") == b"x"
    stage.keep(bytes(99), path=b"/r/5")
    assert len(stage.answers) == 2
    stage.keep(bytes(101), path=b"/r/6")
    assert stage.content(path=b"/r/6") is None


def test_a_document_of_a_template_is_kept_as_values_and_compressed_on_demand(stage: Stage) -> None:
    template = Template(["x" * 2000, "y" * 2000], (0,))
    lasting = Resource("/a", "a", None, source=Source(shown=tuple))
    written = Document(template.fill(["one"]), template, ["one"])
    answer = CachedResponse(lasting, None, written, _FIELDS, ())
    assert answer.size == len("one")
    stage.answers.store(scope(), answer)
    assert stage.content() == written.content
    coded = stage.content(accept_encoding="gzip")
    assert coded is not None and gzip.decompress(coded) == written.content
    assert answer.size == len("one") + len(coded)


def test_a_document_ends_with_its_template(stage: Stage) -> None:
    """A response in gzip is still there."""
    for in_gzip in (False, True):
        template = Template(["x" * 2000, "y" * 2000], (0,))
        content = template.fill(["one"])
        lasting = Resource("/a", "a", None, source=Source(shown=tuple))
        answer = CachedResponse(lasting, None, Document(content, template, ["one"]), _FIELDS, ())
        stage.answers.store(scope(), answer)
        assert stage.content(accept_encoding="gzip" if in_gzip else "") is not None
        del template
        assert stage.content() == (content if in_gzip else None)
    assert len(stage.answers) == 1
