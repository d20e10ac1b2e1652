"""Streams of the client, with a gateway and a cart that drives, and with a server that says what it should not."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosedError

from driven_base import Ideal
from linked_fleet_agent.planar import STANDING
from linked_fleet_agent.robots.of_components import RobotOfComponents
from linked_fleet_client import stream as streams
from linked_fleet_client.control import Control
from linked_fleet_client.errors import (
    BadAnswer,
    Controlled,
    InvalidInput,
    StreamEnded,
    Unreachable,
    Unsupported,
)
from linked_fleet_client.fleet import Fleet
from linked_fleet_client.stream import MOST_SAMPLE_BYTES, Stream
from linked_fleet_client.web import Web
from running import eventually
from small_fleet import Place
from virtual.client import WebSocket
from virtual.loop import VirtualLoop, current
from virtual.processes import serving_robot

pytestmark = pytest.mark.virtual


class InMemory(WebSocket):
    """A WebSocket on virtual time, of which a wait for no time is one of a millisecond."""

    def recv(self, timeout: float = 0.0) -> bytes | str:
        return super().recv(max(timeout, 0.001))


class Hall:
    """A gateway, a cart, and a client of the gateway."""

    def __init__(self, loop: VirtualLoop, root: str, base: Ideal) -> None:
        self.loop, self.root, self.base = loop, root, base
        self.fleet = Fleet(root)

    def stick(self, fleet: Fleet | None = None) -> Stream:
        return (fleet or self.fleet).at("cart/mobile_base").actions["drive"].stream()

    def drive(self, stick: Stream, seconds: float, **given: Any) -> None:
        end_s = self.loop.time() + seconds
        for _ in stick:
            stick.send(**given)
            if self.loop.time() > end_s:
                return

    def stands(self) -> None:
        eventually(lambda: self.base.sent[-1] == STANDING, "a standstill")


@pytest.fixture
def hall(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Hall]:
    loop = current()
    assert loop is not None

    def in_memory(url: str, subprotocols: Sequence[str], additional_headers: Mapping[str, str], **_: Any) -> InMemory:
        return InMemory(loop, url, dict(additional_headers), ", ".join(subprotocols))

    monkeypatch.setattr(streams, "connect", in_memory)
    monkeypatch.setattr(Control, "_renew_repeatedly", lambda control: None)
    place, base = Place(tmp_path), Ideal()
    robot = RobotOfComponents("Cart", base, measure_base=lambda: base.reading)
    with place.gateway() as (_, browser), serving_robot(place.zenoh, "cart", robot):
        eventually(lambda: browser.http.get(place.root + "cart/mobile_base/actions/drive").status_code == 200, "it")
        made = Hall(loop, place.root, base)
        with made.fleet:
            yield made


def test_samples_drive_the_robot_until_the_block_ends(hall: Hall) -> None:
    with hall.stick() as stick:
        hall.drive(stick, 1.0, linear=0.5)
        told = next(iter(stick))
        assert hall.base.sent[-1].linear == told.values["twist"]["linear"] == 0.5
        assert told.applied > 10
        assert set(told.dropped.values()) == {0}
        assert told.values["pose"]["x"] > 0.1
        assert (told.silent, told.speed_scale, told.limited_because) == (False, 1.0, "")
        assert stick.invocation.startswith(hall.root)
    hall.stands()


def test_without_samples_the_robot_brakes_and_says_so(hall: Hall) -> None:
    with hall.stick() as stick:
        hall.drive(stick, 1.0, linear=0.5)
        assert eventually(lambda: next(iter(stick)).silent, "silence")
        hall.stands()


def test_a_sample_that_violates_the_shape_ends_the_stream(hall: Hall) -> None:
    with hall.stick() as stick:
        with pytest.raises(InvalidInput, match="linear"):
            hall.drive(stick, 1.0, linear="fast")
        assert "linear" in str(stick.ended)
        with pytest.raises(StreamEnded, match="linear"):
            stick.send(linear=0.5)


def test_a_sample_that_is_too_long_is_not_sent(hall: Hall) -> None:
    with hall.stick() as stick:
        next(iter(stick))
        with pytest.raises(InvalidInput, match=str(MOST_SAMPLE_BYTES)):
            stick.send(linear=0.5, note="x" * MOST_SAMPLE_BYTES)
        hall.drive(stick, 0.5, linear=0.5)
        assert hall.base.sent[-1].linear == 0.5


def test_control_goes_with_the_stream_and_keeps_others_away(hall: Hall) -> None:
    with Fleet(hall.root) as other, hall.fleet["cart"].control("Ada"), hall.stick() as stick:
        hall.drive(stick, 0.5, linear=0.5)
        assert next(iter(stick)).driver == "Ada"
        with pytest.raises(Controlled, match="Ada controls cart"), hall.stick(other):
            raise AssertionError("the stream was opened")


def test_the_end_of_the_lease_ends_the_stream(hall: Hall) -> None:
    with hall.fleet["cart"].control("Ada"):
        stick = hall.stick().__enter__()
        hall.drive(stick, 0.5, linear=0.5)
    assert len(list(stick)) < 60
    assert "lease" in str(stick.ended)
    hall.stands()


def test_an_action_without_a_stream_has_none(hall: Hall) -> None:
    with pytest.raises(Unsupported, match="stop"):
        hall.fleet["cart"].actions["stop"].stream()


# -- another server ---------------------------------------------------------------------------------------------------


class Said:
    """A connection that says these messages and is then lost."""

    def __init__(self, *messages: str | bytes) -> None:
        self._messages = list(messages)
        self.sent = list[str]()

    def recv(self, timeout: float) -> str | bytes:
        if not self._messages:
            raise ConnectionClosedError(None, None)
        return self._messages.pop(0)

    def send(self, sample: str) -> None:
        self.sent.append(sample)

    def close(self) -> None: ...


def opened(monkeypatch: pytest.MonkeyPatch, said: Said) -> Stream:
    monkeypatch.setattr(streams, "connect", lambda *_, **__: said)
    return Stream(Web(), "http://127.0.0.1:1/a", "lf.drive", None).__enter__()


@pytest.mark.parametrize(
    "message",
    [b"\xff", "[]", "null", "{", '{"time": "now"}', '{"time": true}', '{"values": []}', '{"dropped": 3}', "[" * 10_000],
)
def test_what_is_no_message_is_refused(monkeypatch: pytest.MonkeyPatch, message: str | bytes) -> None:
    with pytest.raises(BadAnswer, match="says what is no"):
        next(iter(opened(monkeypatch, Said(message))))


def test_a_lost_connection_is_told_and_ends_it(monkeypatch: pytest.MonkeyPatch) -> None:
    stick = opened(monkeypatch, Said())
    with pytest.raises(Unreachable, match="the connection was lost"):
        next(iter(stick))
    assert stick.ended == "the connection was lost"


def test_nothing_is_sent_before_the_time_of_the_robot_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    said = Said('{"time": null}', '{"time": 1.5}')
    stick = opened(monkeypatch, said)
    assert not stick.send(linear=1)
    stick._take(0.0)
    assert not stick.send(linear=1)
    stick._take(0.0)
    assert stick.send(linear=1)
    assert [json.loads(each)["seen"] for each in said.sent] == [1.5]
