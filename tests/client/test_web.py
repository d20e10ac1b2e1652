"""Slow, broken or hostile servers: each causes a specific error, and none crashes the client."""

from collections.abc import Iterator
from typing import Any

import pytest

from linked_fleet_client.errors import BadAnswer, ClientError, Problem, Unreachable
from linked_fleet_client.web import MAX_BODY_BYTES, Web
from running import free_port


@pytest.fixture
def web() -> Iterator[Web]:
    web = Web(timeout_s=5)
    yield web
    web.close()


def ok(body: bytes, media_type: str = "text/turtle", *more: str) -> bytes:
    head = [f"HTTP/1.1 200 OK\r\ncontent-type: {media_type}\r\ncontent-length: {len(body)}", *more]
    return "\r\n".join([*head, "connection: close\r\n\r\n"]).encode() + body


def status(number: int, *more: str, body: bytes = b"") -> bytes:
    head = [f"HTTP/1.1 {number} X\r\ncontent-length: {len(body)}\r\nconnection: close", *more, "\r\n"]
    return "\r\n".join(head).encode() + body


@pytest.mark.parametrize(
    ("answer", "error"),
    [
        (ok(b"<> a <broken"), BadAnswer),
        (ok(b"<> <p> " + b"[ <p> " * 20_000), BadAnswer),
        (ok(b"<> <p> ( " + b"( " * 50_000), BadAnswer),
        (ok(b"<html>", "text/html"), BadAnswer),
        (ok(b"{}", "application/ld+json"), BadAnswer),
        (ok(b"\xff\xfe\x00", "text/turtle"), BadAnswer),
        (ok(b'<> <p> "1E999999999"^^<http://www.w3.org/2001/XMLSchema#decimal> .'), BadAnswer),
        (ok(b"<> <p> '''1e999999999''' # 1\n ^^<http://www.w3.org/2001/XMLSchema#decimal> ."), BadAnswer),
        (ok(b" " * (MAX_BODY_BYTES + 1)), BadAnswer),
        (status(302, "location: /x"), BadAnswer),
        (status(302), BadAnswer),
        (status(302, "location: file:///etc/passwd"), BadAnswer),
        (status(302, "location: http://a:b/"), Unreachable),
        (b"", Unreachable),
        (b"SSH-2.0-nothing\r\n", Unreachable),
        (b"HTTP/1.1 200 OK\r\ncontent-type: text/turtle\r\ncontent-length: 99\r\n\r\n<>", Unreachable),
        (status(404), Problem),
        (status(503), Problem),
        (status(400, "content-type: application/problem+json", body=b"[" * 100_000), Problem),
        (status(400, "content-type: application/problem+json", body=b'{"title": 5, "report": {"a": []}}'), Problem),
    ],
)  # fmt: skip
def test_a_bad_answer_is_an_error_of_its_kind(script: Any, web: Web, answer: bytes, error: type[ClientError]) -> None:
    script.answers["/x"] = [answer]
    with pytest.raises(error) as raised:
        web.get(f"{script.url}/x")
    assert len(str(raised.value)) < 1000


def test_a_text_that_looks_like_a_huge_number_is_read(script: Any, web: Web) -> None:
    """One in some thousand digests, which are versions of invocations, has this form."""
    script.answers["/x"] = [ok(b'<> <http://w/version> "12345e1234567890" , "7e12345678"@en .')]
    assert len(web.get(f"{script.url}/x").graph) == 2


def test_a_missing_server_is_unreachable(web: Web) -> None:
    with pytest.raises(Unreachable):
        web.get(f"http://127.0.0.1:{free_port()}/")


@pytest.mark.parametrize("iri", ["file:///etc/passwd", "ftp://a/", "urn:x", "http://a/<b>", "http://", "javascript:1"])
def test_iris_without_http_are_not_requested(web: Web, iri: str) -> None:
    with pytest.raises(BadAnswer):
        web.get(iri)


def test_reading_is_tried_again(script: Any, web: Web) -> None:
    script.answers["/x"] = [status(503), b"", ok(b"<> a <x> .")]
    assert len(web.get(f"{script.url}/x").graph) == 1
    assert len(script.at("/x")) == 3


@pytest.mark.parametrize("answer", [status(503), b""])
def test_doing_is_not_tried_again(script: Any, web: Web, answer: bytes) -> None:
    script.answers["/x"] = [answer]
    with pytest.raises(ClientError):
        web.send("POST", f"{script.url}/x", b"", {})
    assert len(script.at("/x")) == 1


def test_writes_follow_only_redirects_that_keep_the_method(script: Any, web: Web) -> None:
    """308 is followed with the same method; 303 names where to look, and the action is not repeated."""
    script.answers |= {
        "/a": [status(308, "location: /b")],
        "/b": [status(204, "location: /c")],
        "/d": [status(303, "location: /e")],
    }
    assert web.send("POST", f"{script.url}/a", b"x", {}).location() == f"{script.url}/c"
    assert web.send("POST", f"{script.url}/d", b"x", {}).location() == f"{script.url}/e"
    assert [(method, path) for method, path, _ in script.asked] == [("POST", "/a"), ("POST", "/b"), ("POST", "/d")]


def test_a_read_with_an_etag_reuses_the_document_on_304(script: Any, web: Web) -> None:
    script.answers["/x"] = [ok(b"<> a <x> .", "text/turtle", 'etag: "1"'), status(304)]
    first, second = web.get(f"{script.url}/x#one"), web.get(f"{script.url}/x#other")
    assert first is second
    assert script.at("/x")[1]["if-none-match"] == '"1"'


def test_links_of_the_header_are_absolute(script: Any, web: Web) -> None:
    said = 'link: <a>; rel="related next", </b>;rel=up, <http://a:b/>; rel=x, <c>; type="rel=no"'
    script.answers["/x"] = [ok(b"", "text/turtle", said)]
    assert web.get(f"{script.url}/x").links == (
        (f"{script.url}/a", "related"), (f"{script.url}/a", "next"), (f"{script.url}/b", "up"),
    )  # fmt: skip
