"""A cart is driven by a stream between real processes: on one machine, and over a link that delays and loses."""

import contextlib
import json
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import ClientConnection, connect

from bench.lossy import Network, lossy
from bench.table import UnavailableError
from browser import Browser
from running import eventually, free_port, process
from small_fleet import Place, live

pytestmark = pytest.mark.processes
CART = ("examples/base.py",)
LOSS = 0.05


class Stick:
    """A stick that is held forward, until it is released."""

    def __init__(self, socket: ClientConnection) -> None:
        self.told: dict[str, Any] = {}
        self.values: dict[str, Any] = {}
        self.held = True
        self._socket = socket
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        for message in self._socket:
            self.told = json.loads(message)
            self.values |= self.told.get("values", {})
            if self.held and self.told["time"] is not None and not self.told.get("ended"):
                sample = {"seen": self.told["time"], "input": {"linear": 0.3}}
                self._socket.send(json.dumps(sample))

    @property
    def speed(self) -> float:
        return float(self.values.get("twist", {}).get("linear", 0.0))


@contextlib.contextmanager
def stick(place: Place, browser: Browser) -> Iterator[Stick]:
    action = f"{place.root}cart/mobile_base/actions/drive"
    live(browser, "cart")  # a robot whose description has come takes nothing before its first frame (503)
    with connect(action.replace("http", "ws", 1), subprotocols=["lf.drive"]) as socket:  # type: ignore[list-item]
        yield Stick(socket)


def test_a_cart_drives_while_the_stick_is_held_and_brakes_when_it_is_released(tmp_path: Path) -> None:
    place = Place(tmp_path)
    with place.gateway() as (_, browser), process(*CART, "--connect", place.zenoh), stick(place, browser) as held:
        eventually(lambda: held.speed > 0.25, "the cart drives")
        held.held = False
        eventually(lambda: held.told["silent"], "silence")
        eventually(lambda: held.speed == 0, "the cart stands")
        eventually(lambda: held.told.get("ended"), "the end of the stream")
        assert held.told["reason"] == "failed: no sample came for 2 s"
        assert held.told["dropped"]["future"] == held.told["dropped"]["invalid"] == 0


@pytest.fixture(params=[(20.0, True), (100.0, False)], ids=["20 ms", "100 ms"])
def network(request: pytest.FixtureRequest) -> Iterator[tuple[Network, bool]]:
    """Yield a network that delays in each direction and loses 5 %, and whether anybody can drive over it."""
    delay_ms, drives = request.param
    try:
        with lossy(delay_ms, LOSS) as found:
            yield found, drives
    except UnavailableError as error:
        pytest.skip(str(error))


@pytest.mark.test_all
def test_over_a_bad_link_nothing_drives_that_is_late(tmp_path: Path, network: tuple[Network, bool]) -> None:
    """With 100 ms each way every sample is older than the limit when it arrives, and the cart never moves."""
    link, drives = network
    place = Place(tmp_path, zenoh=f"tcp/{link.here}:{free_port()}")
    with (
        process(*place.command(), "--allow", "plain-zenoh") as gateway,
        process(*link.python(*CART, "--connect", place.zenoh)),
        contextlib.closing(Browser(place.root)) as browser,
    ):
        gateway.said("serving")
        with stick(place, browser) as held:
            if drives:
                eventually(lambda: held.told.get("applied", 0) > 100, "samples that are applied")
                eventually(lambda: held.values["pose"]["x"] > 0.2, "the cart drives")
            else:
                eventually(lambda: held.told.get("dropped", {}).get("late", 0) > 100, "samples that are late")
                assert held.told["applied"] == 0
                assert held.values["pose"]["x"] == 0
            assert held.told["dropped"]["future"] == held.told["dropped"]["invalid"] == 0
