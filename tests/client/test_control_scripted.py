"""Control with a server that answers as scripted: which answers mean that it is lost, and the thread that renews it."""

import contextlib
from collections.abc import Iterator
from typing import Any

import pytest

from linked_fleet_client.control import Control
from linked_fleet_client.errors import BadAnswer, ControlLost, Problem, Unreachable
from linked_fleet_client.fleet import Fleet
from running import eventually

TEXT = b"""@prefix lf: <https://w3id.org/linked-fleet#> . @prefix hybrit: <https://hybr-it-projekt.de/ns/hybr-it#> .
@prefix http: <http://www.w3.org/2011/http#> . @prefix dcterms: <http://purl.org/dc/terms/> .
"""
ROBOT = TEXT + b'</r> dcterms:identifier "arm" ; lf:lease </lease> ; hybrit:action </move> .'
MOVE = TEXT + b'</move> a hybrit:Action ; hybrit:binding [ http:mthd "POST" ; http:requestURI </run> ] .'
AWAY = MOVE.replace(b"</run>", b"<http://localhost:1/run>")


def turtle(body: bytes) -> bytes:
    head = f"HTTP/1.1 200 X\r\ncontent-type: text/turtle\r\ncontent-length: {len(body)}\r\nconnection: close\r\n\r\n"
    return head.encode() + body


def answer(status: int, fields: str = "") -> bytes:
    return f"HTTP/1.1 {status} X\r\n{fields}content-length: 0\r\nconnection: close\r\n\r\n".encode()


def granted(token: str = "<urn:uuid:1>") -> bytes:
    return answer(204, f"lock-token: {token}\r\n")


@pytest.fixture
def robot(script: Any) -> Iterator[Fleet]:
    script.answers |= {"/r": [turtle(ROBOT)], "/move": [turtle(MOVE)], "/run": [answer(204)]}
    with Fleet(f"{script.url}/r") as robot:
        yield robot


@pytest.fixture
def renewed_by_the_test(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Control, "_renew_repeatedly", lambda control: None)


def unsafe(script: Any) -> list[tuple[str, str, str | None]]:
    """Return method, path and lock token of each unsafe request."""
    return [(method, path, fields.get("lock-token")) for method, path, fields in script.asked if method != "GET"]


def test_the_lease_is_taken_renewed_used_and_given_back_with_its_token(script: Any, robot: Fleet) -> None:
    """By a thread, as often as a short lease needs."""
    script.answers["/lease"] = [granted()]
    with robot.control("me", duration_s=0.5):
        eventually(lambda: len(script.at("/lease")) >= 4, "three renewals")
        robot.actions["move"]()
    proof = "<urn:uuid:1>"
    first, *others, last = unsafe(script)
    assert (first, last) == (("PUT", "/lease", None), ("DELETE", "/lease", proof))
    assert set(others) == {("PUT", "/lease", proof), ("POST", "/run", proof)}


def test_the_thread_renews_again_after_a_failure_and_ends_with_a_loss(script: Any, robot: Fleet) -> None:
    script.answers["/lease"] = [granted(), answer(503), b"", granted(), answer(409)]
    with pytest.raises(ControlLost, match="409"), robot.control("me", duration_s=1.2) as control:
        control._renewing.join(30)
        assert not control._renewing.is_alive()
    assert [method for method, *_ in unsafe(script)] == ["PUT"] * 5


@pytest.mark.usefixtures("renewed_by_the_test")
@pytest.mark.parametrize(
    ("status", "error", "lost"),
    [
        (409, Problem, False),  # such as a collision
        (412, ControlLost, True),
        (422, Problem, False),
        (423, ControlLost, True),
        (503, Problem, False),
    ],
)
def test_a_motion_that_is_refused_for_want_of_control(
    script: Any, robot: Fleet, status: int, error: type[Exception], lost: bool
) -> None:
    script.answers |= {"/lease": [granted()], "/run": [answer(status)]}
    with pytest.raises(ControlLost) if lost else contextlib.nullcontext(), robot.control("me"):
        with pytest.raises(error):
            robot.actions["move"]()
        script.answers["/run"] = [answer(204)]
        if lost:
            with pytest.raises(ControlLost):
                robot.actions["move"]()
            assert len(script.at("/run")) == 1, "it is sent no more"
        else:
            robot.actions["move"]()


@pytest.mark.usefixtures("renewed_by_the_test")
@pytest.mark.parametrize(
    ("ending", "error"),
    [
        (answer(204), None),
        (answer(404), ControlLost),
        (answer(409), ControlLost),
        (answer(412), ControlLost),
        (answer(423), ControlLost),
        (answer(500), Problem),
        (b"", Unreachable),
    ],
)
def test_how_a_block_ends(script: Any, robot: Fleet, ending: bytes, error: type[Exception] | None) -> None:
    script.answers["/lease"] = [granted(), ending]
    with contextlib.nullcontext() if error is None else pytest.raises(error), robot.control("me"):
        pass
    assert robot.web.controls == {}


@pytest.mark.usefixtures("renewed_by_the_test")
@pytest.mark.parametrize(
    ("status", "lost"), [(400, True), (401, True), (404, True), (409, True), (423, True), (429, False), (503, False)]
)
def test_a_renewal_that_is_refused(script: Any, robot: Fleet, status: int, lost: bool) -> None:
    """The client knows for sure that it has lost control, or it may try again."""
    script.answers["/lease"] = [granted(), answer(status, "retry-after: 1\r\n"), answer(204)]
    with (
        pytest.raises(ControlLost) if lost else contextlib.nullcontext(),
        robot.control("me") as control,
        pytest.raises(ControlLost if lost else Problem),
    ):
        control.renew()
    assert len(script.at("/lease")) == (2 if lost else 3)


@pytest.mark.usefixtures("renewed_by_the_test")
def test_a_renewal_that_takes_a_new_lease_gives_it_back(script: Any, robot: Fleet) -> None:
    script.answers["/lease"] = [granted(), granted("<urn:uuid:2>"), answer(204)]
    with pytest.raises(ControlLost, match="ended before"), robot.control("me") as control:
        control.renew()
    assert unsafe(script)[-1] == ("DELETE", "/lease", "<urn:uuid:2>")


@pytest.mark.usefixtures("renewed_by_the_test")
def test_another_server_does_not_get_the_token(script: Any, robot: Fleet, monkeypatch: pytest.MonkeyPatch) -> None:
    script.answers |= {"/lease": [granted()], "/move": [turtle(AWAY)]}
    sent: list[dict[str, str]] = []
    with robot.control("me"):
        monkeypatch.setattr(robot.web, "send", lambda method, url, body, headers: sent.append(headers))
        with pytest.raises(AttributeError):  # there is no answer
            robot.actions["move"]()
        monkeypatch.undo()
    assert sent and "lock-token" not in sent[0]


def test_a_grant_without_a_token_is_none(script: Any, robot: Fleet) -> None:
    script.answers["/lease"] = [answer(204)]
    with pytest.raises(BadAnswer, match="without a Lock-Token"), robot.control("me"):
        raise AssertionError("control was granted")
