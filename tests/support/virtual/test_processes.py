"""Gateways and agents in the loop end like processes, and only what belongs to them ends with them."""

import signal
from pathlib import Path

import pytest

from running import process
from small_fleet import Place
from virtual.loop import VirtualLoop, current
from virtual.processes import world

pytestmark = pytest.mark.virtual


def test_the_embedded_server_outlives_a_gateway_that_is_killed(tmp_path: Path) -> None:
    loop = current()
    assert isinstance(loop, VirtualLoop)
    with process(
        "-m",
        "linked_fleet_gateway",
        "--port",
        "8000",
        "--zenoh-listen",
        "tcp/127.0.0.1:7447",
        "--state-dir",
        str(tmp_path),
    ) as gateway:
        gateway.said("serving")
        gateway.send(signal.SIGKILL)
    address = ("127.0.0.1", world(loop).embedded(tmp_path).port)
    assert address in loop.internet._listeners


def test_the_output_of_a_process_is_what_that_one_logs(tmp_path: Path) -> None:
    first, second = Place(tmp_path / "first"), Place(tmp_path / "second")
    with process(*first.command()) as one, process(*second.command()) as other:
        for each in (one, other):
            each.said("serving")
        with first.ur5():
            one.said("robot ur5: appeared")
    assert "ur5" not in other.output


def test_a_gateway_that_cannot_begin_says_why_in_a_line_and_ends(tmp_path: Path) -> None:
    missing = str(tmp_path / "identities.toml")
    with process("-m", "linked_fleet_gateway", *Place(tmp_path).command()[2:], "--identities", missing) as gateway:
        assert gateway.ended() == 1
        assert [line for line in gateway.lines if line.startswith("gateway: ") and missing in line]
