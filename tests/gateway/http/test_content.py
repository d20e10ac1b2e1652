"""Content that an extension has made itself, by its entity tag and content codings (RFC 9110, 8.4, 8.8.3, 13.1)."""

import gzip
from typing import Any

import pytest
from starlette.responses import Response

from linked_fleet_base.errors import PreconditionFailed
from linked_fleet_gateway.http.arrival import create_arrival
from linked_fleet_gateway.http.content import Content
from linked_fleet_gateway.http.request import Request

_BODY = b"a robot, " * 500
_HEADERS = {"content-type": "text/plain", "vary": "Accept-Encoding"}


def _answer(content: Content, **fields: str) -> Response:
    headers = [(name.replace("_", "-").encode(), value.encode()) for name, value in fields.items()]
    scope: dict[str, Any] = {"type": "http", "method": "GET", "path": "/", "query_string": b"", "headers": headers}
    create_arrival(scope)
    return content.response(Request(scope), _HEADERS)


def test_long_content_is_sent_in_gzip_to_clients_that_prefer_it() -> None:
    content = Content.of(_BODY)
    plain, coded = _answer(content), _answer(content, accept_encoding="gzip")
    assert plain.body == _BODY and "content-encoding" not in plain.headers
    assert gzip.decompress(bytes(coded.body)) == _BODY and coded.headers["content-encoding"] == "gzip"
    assert plain.headers["etag"] == content.etag != coded.headers["etag"]
    assert content.size == len(_BODY) + len(coded.body)


def test_short_content_has_no_coding() -> None:
    answer = _answer(Content.of(b"short"), accept_encoding="gzip")
    assert (answer.body, answer.headers["etag"]) == (b"short", Content.of(b"short").etag)


@pytest.mark.parametrize("coding", ["", "gzip"])
def test_a_client_that_has_the_content_gets_304(coding: str) -> None:
    content = Content.of(_BODY)
    tag = _answer(content, accept_encoding=coding).headers["etag"]
    answer = _answer(content, accept_encoding=coding, if_none_match=tag)
    assert (answer.status_code, answer.body, answer.headers["etag"]) == (304, b"", tag)
    assert answer.headers["vary"] == "Accept-Encoding" and "content-type" not in answer.headers


def test_if_match_names_the_present_content() -> None:
    content = Content(b"a picture", '"7-1-jpeg"')
    assert _answer(content, if_match='"7-1-jpeg"').status_code == 200
    with pytest.raises(PreconditionFailed, match="7-1-jpeg"):
        _answer(content, if_match='"7-0-jpeg"')
