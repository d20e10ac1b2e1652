"""Distant robots: over QUIC, and behind a chain of Zenoh routers of which one is restarted."""

import contextlib
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from browser import Browser
from commanding import PAN, STILL_RAD, WRIST, angle, begun, moving, of_joint, put, radian, slowly
from running import Process, free_port, process
from small_fleet import Place, live, offline

pytestmark = pytest.mark.processes


def turns(browser: Browser, target: float) -> None:
    """Check that a command and the frames of its motion arrive."""
    begun(put(browser, of_joint(browser, WRIST), radian(target), prefer="wait=30"))
    assert angle(browser, WRIST) == pytest.approx(target, abs=STILL_RAD)


# -- QUIC -----------------------------------------------------------------------------------------------------------

_KEY = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")


def _openssl(folder: Path, *words: str) -> None:
    subprocess.run(("openssl", *words), cwd=folder, check=True, capture_output=True)


def authority(folder: Path, name: str) -> Path:
    """Return the certificate of a new authority."""
    _openssl(folder, "req", "-x509", *_KEY, "-keyout", f"{name}.key", "-out", f"{name}.pem", "-subj", f"/CN={name}")
    return folder / f"{name}.pem"


def certified(folder: Path, ca: Path) -> tuple[Path, Path]:
    """Return key and certificate of loopback, signed by the authority."""
    (folder / "names").write_text("subjectAltName=DNS:localhost,IP:127.0.0.1\n")
    _openssl(folder, "req", *_KEY, "-keyout", "own.key", "-out", "own.csr", "-subj", "/CN=localhost")
    signing = ("-CA", str(ca), "-CAkey", str(ca.with_suffix(".key")), "-CAcreateserial", "-extfile", "names")
    _openssl(folder, "x509", "-req", "-in", "own.csr", "-out", "own.pem", *signing)
    return folder / "own.key", folder / "own.pem"


def test_a_robot_over_quic(tmp_path: Path) -> None:
    """A robot that trusts the gateway's certificate joins; another one stays away and says so."""
    ours, theirs = authority(tmp_path, "ours"), authority(tmp_path, "theirs")
    key, certificate = certified(tmp_path, ours)
    where = f"127.0.0.1:{free_port()}"
    listen = f"quic/{where}#listen_private_key_file={key};listen_certificate_file={certificate}"
    place = Place(tmp_path / "state", zenoh=listen)

    def agent(name: str, trusted: Path) -> contextlib.AbstractContextManager[Process]:
        connect = f"quic/{where}#root_ca_certificate_file={trusted}"
        return process("-m", "linked_fleet_agent", f"--robot={name}=ur5", "--connect", connect)

    with place.gateway() as (_, browser), agent("ur5", ours), agent("stranger", theirs) as stranger:
        live(browser, "ur5")
        turns(browser, 0.3)
        stranger.said("no answer from")
        assert len(browser.robots()) == 1


# -- routers --------------------------------------------------------------------------------------------------------


class Router:
    """A router that can be killed and restarted at the same endpoint."""

    def __init__(self, *others: str) -> None:
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self._others = others
        self._open = contextlib.ExitStack()
        self._process: Process

    def start(self) -> None:
        self._process = self._open.enter_context(process("tests/support/zenoh_router.py", self.endpoint, *self._others))
        self._process.said("routing")

    def kill(self) -> None:
        self._process.send(signal.SIGKILL)
        self._process.ended()

    def close(self) -> None:
        self._open.close()


@pytest.fixture
def chain() -> Iterator[tuple[Router, Router]]:
    """Yield two routers; the second connects to the first."""
    with contextlib.closing(Router()) as near, contextlib.closing(Router(near.endpoint)) as far:
        near.start()
        far.start()
        yield near, far


def test_a_robot_behind_two_routers(tmp_path: Path, chain: tuple[Router, Router]) -> None:
    """It joins, moves and is heard; after either router is killed and restarted, it comes back and accepts commands."""
    near, far = chain
    port = free_port()
    command = ("--port", str(port), "--zenoh-connect", near.endpoint, "--state-dir", str(tmp_path))
    with (
        process("-m", "linked_fleet_agent", "--robot=ur5", "--connect", far.endpoint),
        process("-m", "linked_fleet_gateway", *command) as gateway,
        contextlib.closing(Browser(f"http://127.0.0.1:{port}/")) as browser,
    ):
        gateway.said("serving")
        live(browser, "ur5")
        turns(browser, 0.3)
        for router, target in ((far, -0.3), (near, 0.3)):
            begun(put(browser, of_joint(browser, PAN), slowly(angle(browser, PAN) + 1.0)))
            moving(browser, PAN)
            router.kill()
            offline(browser, "ur5")
            router.start()
            live(browser, "ur5")
            turns(browser, target)
