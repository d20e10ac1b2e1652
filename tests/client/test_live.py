"""Event streams: framing, resumption, reconnection and their end."""

import queue
import socket
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_client import live
from linked_fleet_client.errors import BadAnswer, Problem, Unreachable
from linked_fleet_client.live import Event, Feed, events, lines
from linked_fleet_client.web import Web

HEAD = b"HTTP/1.1 200 OK\r\ncontent-type: text/event-stream\r\nconnection: close\r\n\r\nretry: 1\n"
OVER = b"HTTP/1.1 204 No Content\r\nconnection: close\r\n\r\n"
TEXT = '@prefix lf: <https://w3id.org/linked-fleet#> . <> lf:version "{}" ; lf:previousVersion "{}" ; lf:value {} .'


def event(version: str, before: str, value: float) -> bytes:
    return f"id: {version}\ndata: {TEXT.format(version, before, value)}\n\n".encode()


@pytest.fixture
def web() -> Iterator[Web]:
    web = Web(timeout_s=5)
    yield web
    web.close()


def numbers(feed: Feed) -> list[tuple[float | None, bool]]:
    return [(change.reading.main.number if change.reading.main else None, change.missed) for change in feed]


def test_a_stream_that_breaks_is_resumed_where_it_was_until_it_is_over(script: Any, web: Web) -> None:
    """It sends the last Last-Event-ID; 204 ends it; conflated messages are reported."""
    script.answers["/x"] = [HEAD + event("1", "0", 1.5) + event("2", "1", 2.5), b"", HEAD + event("5", "4", 5.5), OVER]
    assert numbers(Feed(web, f"{script.url}/x")) == [(1.5, False), (2.5, False), (5.5, True)]
    assert [fields.get("last-event-id") for fields in script.at("/x")] == [None, "2", "2", "5"]


def test_a_feed_is_closed_while_it_waits_for_the_server(web: Web) -> None:
    """A thread that waits for events ends at once, without raising."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        feed = Feed(web, f"http://127.0.0.1:{server.getsockname()[1]}/x")
        told: queue.Queue[str | None] = queue.Queue()
        reader = threading.Thread(target=lambda: [told.put(change.version) for change in feed])
        reader.start()
        connection, _ = server.accept()
        with connection:
            connection.recv(65536)
            connection.sendall(HEAD + event("1", "0", 1.5))
            assert told.get(timeout=30) == "1"
            feed.close()
            reader.join(30)
            assert not reader.is_alive()


def test_a_closed_client_is_unreachable_and_no_other_error(web: Web) -> None:
    web.close()
    with pytest.raises(Unreachable, match="closed"):
        web.get("http://127.0.0.1:1/")
    assert list(_closed(Feed(web, "http://127.0.0.1:1/"))) == []


def _closed(feed: Feed) -> Feed:
    feed.close()
    return feed


def test_an_id_without_data_is_where_to_resume(script: Any, web: Web) -> None:
    script.answers["/x"] = [HEAD + event("1", "0", 1.5) + b"id: cancelled\n\n", OVER]
    assert numbers(Feed(web, f"{script.url}/x")) == [(1.5, False)]
    assert script.at("/x")[1]["last-event-id"] == "cancelled"


def test_a_server_that_is_busy_is_asked_again(script: Any, web: Web, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, "_FIRST_PAUSE_S", 0.001)
    busy = b"HTTP/1.1 503 X\r\ncontent-length: 0\r\nconnection: close\r\n\r\n"
    script.answers["/x"] = [busy, busy, HEAD + event("1", "0", 1.5), OVER]
    assert numbers(Feed(web, f"{script.url}/x")) == [(1.5, False)]


def test_a_server_that_wants_clients_back_at_once_is_not_flooded(script: Any, web: Web) -> None:
    script.answers["/x"] = [HEAD.replace(b"retry: 1", b"retry: 0") + event("1", "0", 1.5), b""]
    feed = Feed(web, f"{script.url}/x", deadline=time.monotonic() + 0.5)
    assert numbers(feed) == [(1.5, False)]
    assert len(script.at("/x")) <= 10


def test_a_resource_may_be_missing_for_a_moment(script: Any, web: Web, monkeypatch: pytest.MonkeyPatch) -> None:
    """A restarted gateway does not know its robots at once."""
    monkeypatch.setattr(live, "_LEAST_PAUSE_S", 0.001)
    gone = b"HTTP/1.1 404 X\r\ncontent-length: 0\r\nconnection: close\r\n\r\n"
    script.answers["/x"] = [HEAD + event("1", "0", 1.5), gone, HEAD + event("2", "1", 2.5), gone]
    told = []
    with pytest.raises(Problem, match="404"):
        for change in Feed(web, f"{script.url}/x"):
            told.append(change.version)
    assert told == ["1", "2"]
    assert len(script.at("/x")) > 5


def test_a_missing_resource_is_an_error(script: Any, web: Web) -> None:
    with pytest.raises(Problem, match="404"):
        list(Feed(web, f"{script.url}/nothing"))


def test_an_event_that_is_no_rdf_is_an_error(script: Any, web: Web) -> None:
    script.answers["/x"] = [HEAD + b"data: {}\n\n"]
    with pytest.raises(BadAnswer):
        list(Feed(web, f"{script.url}/x"))


def test_a_deadline_ends_it(script: Any, web: Web) -> None:
    script.answers["/x"] = [HEAD + event("1", "0", 1.5)]
    feed = Feed(web, f"{script.url}/x", deadline=time.monotonic() + 0.2)
    assert [number for number, _ in numbers(feed)][:1] == [1.5]


def test_fields_are_read_as_the_standard_has_them() -> None:
    said = [
        "data:a",
        "data: b",
        "data:  c",
        "ignored: x",
        "id: 7",
        "",
        "id: 8\0",
        "data",
        "",
        "retry: 1500",
        ": hello",
        "",
    ]
    assert list(events(said)) == [
        Event("a\nb\n c", "7"), Event("", "7"), Event("", "7", 1.5), Event("", "7", 1.5),
    ]  # fmt: skip


WORDS = st.lists(st.text(alphabet="ab\u2028\x85é", max_size=4), max_size=6)


@given(WORDS, st.sampled_from(["\n", "\r", "\r\n"]), st.data())
def test_lines_are_the_same_however_they_arrive(said: list[str], end: str, data: st.DataObject) -> None:
    """The input is split anywhere, even between CR and LF or within a character; other Unicode line ends are text."""
    whole = "".join(line + end for line in [*said, "x"]).encode() + b"x"
    cuts = sorted(data.draw(st.sets(st.integers(0, len(whole)), max_size=5)))
    parts = [whole[start:stop] for start, stop in zip([0, *cuts], [*cuts, len(whole)], strict=True)]
    assert list(lines(parts)) == [*said, "x"]
