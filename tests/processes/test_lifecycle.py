"""Agents and gateways as processes: signals, exit codes, ports in use."""

import signal
import socket
from pathlib import Path

import pytest

from fake_robots import open_session
from running import eventually, process
from small_fleet import Place, live, offline

pytestmark = pytest.mark.processes


def test_killed_processes_restart_and_terminated_ones_end_cleanly(tmp_path: Path) -> None:
    """The gateway restarts on its ports; SIGTERM ends both with 0 and without a traceback."""
    place = Place(tmp_path)
    with place.gateway() as (first, browser):
        with place.ur5() as agent:
            live(browser, "ur5")
            # Zenoh would share memory with each neighbour here, and keep it after a kill.
            assert ".zenoh" not in first.mapped + agent.mapped
            agent.send(signal.SIGKILL)
            offline(browser, "ur5")
        with place.ur5() as agent:
            live(browser, "ur5")
            first.send(signal.SIGKILL)
            first.ended()
            with place.gateway() as (second, browser):
                live(browser, "ur5")
                agent.send(signal.SIGTERM)
                offline(browser, "ur5")
                assert agent.ended() == 0
                second.send(signal.SIGTERM)
                assert second.ended() == 0
    assert "Traceback" not in agent.output + second.output


def test_second_agent_of_a_name_refuses_to_start(tmp_path: Path) -> None:
    """It says why and ends with an error; the first one continues, although it started beside a stale token."""
    place = Place(tmp_path)
    with place.gateway() as (gateway, browser), open_session(place.zenoh) as session:
        token = session.liveliness().declare_token("fleet/robot/ur5/presence/whoever")
        with place.ur5() as first:
            live(browser, "ur5")
            with place.ur5("--lease-ms", "300") as second:
                assert second.ended() == 3
            live(browser, "ur5")
            assert "vanished" not in gateway.output
        token.undeclare()
    assert "'ur5' is taken" in second.output
    assert gateway.output.count("robot ur5: appeared") == 1
    assert "Traceback" not in first.output + second.output


@pytest.mark.parametrize("taken", ["http", "zenoh"])
def test_taken_port_is_one_line(tmp_path: Path, taken: str) -> None:
    """Whichever port it is: one line that names it, exit code 1."""
    place = Place(tmp_path)
    number = place.port if taken == "http" else int(place.zenoh.rpartition(":")[2])
    with socket.create_server(("127.0.0.1", number)), process(*place.command()) as gateway:
        assert gateway.ended() == 1
    (line,) = gateway.lines
    assert line.startswith("gateway: ")
    assert str(number) in line


def test_two_gateways_started_at_once(tmp_path: Path) -> None:
    """Exactly one of two gateways on one HTTP port serves, however close their starts are."""
    place, other = Place(tmp_path / "a"), Place(tmp_path / "b")
    other.port = place.port
    with process(*place.command()) as one, process(*other.command()) as two:
        refused = eventually(
            lambda: next((each for each in (one, two) if "cannot listen" in each.output), None), "one gives up"
        )
        assert refused.ended() == 1
        (two if refused is one else one).said("serving")
