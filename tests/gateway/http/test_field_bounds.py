"""Header fields and queries are bounded in members before they are parsed; a stop is not prevented by them."""

from collections.abc import Iterator
from typing import Any

import pytest

from browser import Browser
from fake_robots import FakeRobot, open_session
from linked_fleet_gateway.http.field_bounds import (
    MAX_LINES,
    MAX_MEMBERS,
    MAX_PARAMETERS,
    enforce_bounds,
    is_within_bounds,
)
from small_fleet import Place, live

pytestmark = pytest.mark.virtual

_MEMBERS = {
    "accept": "text/turtle,",
    "accept-encoding": "gzip,",
    "accept-language": "en,",
    "callback": "http://127.0.0.1:9/,",
    "connection": "upgrade,",
    "content-type": ";a=b",
    "cookie": "a=b;",
    "forwarded": "for=127.0.0.1,",
    "idempotency-key": "k,",
    "if-match": '"x",',
    "if-none-match": '"x",',
    "link": "<a>;",
    "lock-token": "<urn:uuid:1>,",
    "prefer": "wait=0,",
    "range": "0-1,",
    "sec-websocket-protocol": "lf.turtle,",
    "traceparent": "x,",
    "x-forwarded-for": "127.0.0.1,",
}


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (gateway, browser), open_session(place.zenoh) as session:
        FakeRobot(session, "arm").appear().stand(0.1)
        live(browser, "arm")
        yield browser
        assert "Traceback" not in gateway.output, gateway.output


@pytest.mark.parametrize("name", _MEMBERS)
def test_a_field_with_too_many_members_is_refused_by_name(browser: Browser, name: str) -> None:
    for method, path in (("GET", ""), ("GET", "nowhere"), ("PUT", "arm/title"), ("GET", "health")):
        answer = browser.http.request(method, browser.root + path, headers={name: _MEMBERS[name] * (MAX_MEMBERS + 1)})
        assert answer.status_code == 431, (path, answer.text)
        assert name in answer.json()["detail"] and str(MAX_MEMBERS) in answer.json()["detail"]


@pytest.mark.parametrize("name", _MEMBERS)
def test_a_field_with_as_many_members_as_permitted_is_read(browser: Browser, name: str) -> None:
    value = (_MEMBERS[name] * MAX_MEMBERS).rstrip(",;")[: None if name != "content-type" else -4]
    answer = browser.http.get(browser.root, headers={name: value})
    assert answer.status_code in (200, 400, 412, 426), answer.text


@pytest.mark.parametrize("name", [each for each in _MEMBERS if each != "connection"])
def test_a_stop_is_read_without_such_a_field(browser: Browser, name: str) -> None:
    for path in ("actions/stopAll", "actions/stopAll?" + "a&" * MAX_PARAMETERS):
        answer = browser.http.post(browser.root + path, headers={name: _MEMBERS[name] * 500})
        assert (answer.status_code, answer.json()["unanswered"]) == (504, ["arm"]), "it is sent, nobody answers"


def test_several_lines_count_as_one_field(browser: Browser) -> None:
    answer = browser.http.get(browser.root, headers=[("prefer", "wait=0")] * (MAX_MEMBERS + 1))
    assert answer.status_code == 431 and "prefer" in answer.text


def test_the_lines_of_a_head_are_bounded(browser: Browser) -> None:
    many = {f"x-{number}": "1" for number in range(MAX_LINES + 1)}
    answer = browser.http.get(browser.root, headers=many)
    assert answer.status_code == 431 and str(MAX_LINES) in answer.json()["detail"]
    assert browser.http.post(browser.root + "actions/stopAll", headers=many).json()["unanswered"] == ["arm"]


def test_the_parameters_of_a_query_are_bounded(browser: Browser) -> None:
    answer = browser.http.get(browser.root + "?" + "a&" * MAX_PARAMETERS)
    assert answer.status_code == 400 and str(MAX_PARAMETERS) in answer.json()["detail"]


@pytest.mark.parametrize(
    "value", [b",a" * MAX_MEMBERS, b'""' * (MAX_MEMBERS + 1), b";a" * MAX_MEMBERS, b"a," * 40 + b"a;" * 40]
)
def test_members_are_counted_without_parsing(value: bytes) -> None:
    scope: dict[str, Any] = {
        "type": "http", "method": "GET", "path": "/", "query_string": b"",
        "headers": [(b"host", b"a"), (b"accept", value), (b"x-other", value)],
    }  # fmt: skip
    assert not is_within_bounds(scope)
    assert enforce_bounds(scope) is not None
    assert is_within_bounds(scope)
    assert [name for name, _ in scope["headers"]] == [b"host", b"x-other"]
