"""The web app of teleop, a package of other people, drives a base by ``examples/phone.py``."""

import contextlib
import json
import os
import ssl
import subprocess
import sys
import time
from collections.abc import Iterator

import httpx
import pytest
from websockets.sync.client import ClientConnection, connect

from browser import Browser
from running import ROOT, eventually, free_port, process
from small_fleet import Place, live

pytestmark = [pytest.mark.test_all, pytest.mark.processes]

CLIENTS = ROOT / "build" / "clients"
RATE_HZ = 30.0


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    place = Place(tmp_path_factory.mktemp("state"))
    with process(*place.command()) as gateway:
        gateway.said("serving")
        with process("examples/base.py", "--connect", place.zenoh):
            with contextlib.closing(Browser(place.root)) as browser:
                live(browser, "cart")
            yield place


def _base(place: Place) -> str:
    return f"{place.root}cart/mobile_base"


@pytest.fixture
def phone(place: Place) -> Iterator[ClientConnection]:
    """The socket of the app's page, to the example that drives the cart."""
    port = free_port()
    around = {**os.environ, "PYTHONPATH": os.pathsep.join([str(CLIENTS), *sys.path])}
    command = [sys.executable, "examples/phone.py", f"{_base(place)}/actions/drive", "--host", "127.0.0.1"]
    bridge = subprocess.Popen([*command, "--port", str(port)], cwd=ROOT, env=around)
    trusting = ssl.create_default_context()
    trusting.check_hostname, trusting.verify_mode = False, ssl.CERT_NONE  # its certificate is its own
    try:
        eventually(lambda: _answers(port), "the app of the phone")
        with connect(f"wss://127.0.0.1:{port}/ws", ssl=trusting) as socket:
            yield socket
    finally:
        bridge.kill()
        bridge.wait()


def _answers(port: int) -> bool:
    try:
        return httpx.get(f"https://127.0.0.1:{port}/", verify=False).status_code == 200
    except httpx.TransportError:
        return False


def pose(ahead_m: float, *, move: bool) -> str:
    """Return what the page of the app sends: the pose of the phone in the axes of WebXR."""
    at, level = {"x": 0.0, "y": 0.0, "z": -ahead_m}, {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}
    return json.dumps({"type": "pose", "data": {"move": move, "position": at, "orientation": level}})


def _x(place: Place) -> float:
    answer = httpx.get(f"{_base(place)}/pose", headers={"accept": "application/json"}).json()
    return float(answer["value"]["x"])


def _speed(place: Place) -> float:
    answer = httpx.get(f"{_base(place)}/twist", headers={"accept": "application/json"}).json()
    return float(answer["value"]["linear"])


def test_it_drives_while_the_button_is_held(place: Place, phone: ClientConnection) -> None:
    began = _x(place)

    def hold() -> bool:
        """Move the phone ahead by a few centimetres at a time, which the app takes for no jump."""
        nonlocal ahead_m
        ahead_m = min(ahead_m + 0.02, 0.2)
        phone.send(pose(ahead_m, move=True))
        time.sleep(1.0 / RATE_HZ)
        return _x(place) > began + 0.3

    ahead_m = 0.0
    eventually(hold, "a cart that has driven")
    phone.send(pose(ahead_m, move=False))
    eventually(lambda: abs(_speed(place)) < 1e-3, "a cart that stands")


def test_it_brakes_when_the_phone_falls_silent(place: Place, phone: ClientConnection) -> None:
    def hold() -> bool:
        phone.send(pose(next(ahead), move=True))
        return abs(_speed(place)) > 0.1

    ahead = iter([*(0.02 * step for step in range(10)), *[0.2] * 1000])
    eventually(hold, "a cart that drives")
    eventually(lambda: abs(_speed(place)) < 1e-3, "a cart that stands")
