"""The cost for a gateway of showing five robots at 100 Hz to two Foxglove clients.

``PYTHONPATH=.:tests:tests/support python -m bench.foxglove``
"""

import argparse
import contextlib
import json
import sys
import threading
import time

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from bench.crowd import Scene, Size, stage
from bench.scene import cpu_s
from bench.table import Row

SIZE = Size(robots=5, joints=18, models=5, rates_hz=(100,))
CLIENTS, MOST_PERCENT = 2, 15.0
_SETTLED_S = 3.0


class Viewer:
    """A client that subscribes to all channels except pictures, and counts its messages."""

    def __init__(self, port: int) -> None:
        url = f"ws://127.0.0.1:{port}/foxglove"
        self._socket: ClientConnection = connect(url, subprotocols=["foxglove.sdk.v1"], compression=None)  # type: ignore[list-item]
        self.joint_states = self.messages = 0
        self._states: set[int] = set()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        with contextlib.suppress(ConnectionClosed):
            for message in self._socket:
                if isinstance(message, str):
                    self._take(json.loads(message))
                else:
                    self.messages += 1
                    self.joint_states += int.from_bytes(message[1:5], "little") in self._states

    def _take(self, said: dict[str, list[dict[str, int | str]]]) -> None:
        wanted = [{"id": each["id"], "channelId": each["id"]} for each in said.get("channels", ())]
        self._states |= {int(each["id"]) for each in said.get("channels", ()) if "joint_states" in str(each["topic"])}
        if wanted:
            self._socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    def close(self) -> None:
        self._socket.close()
        self._thread.join()


def rows(seconds: float, size: Size = SIZE) -> list[Row]:
    with stage(size, 1) as scene:
        one, (rate_hz,) = scene.gateways[0], size.rates_hz
        scene.crowd.ask(f"rate {rate_hz:g}")
        scene.crowd.ask("appear")
        one.meet(size.robots)
        time.sleep(_SETTLED_S)
        alone = _percent(scene, seconds)
        viewers = [Viewer(one.port) for _ in range(CLIENTS)]
        time.sleep(_SETTLED_S)
        before = sum(each.joint_states for each in viewers)
        shown = _percent(scene, seconds)
        rate = (sum(each.joint_states for each in viewers) - before) / seconds / CLIENTS / size.robots
        for each in viewers:
            each.close()
        time.sleep(_SETTLED_S)
        after = _percent(scene, seconds)
    name = f"{size.robots} robots at {rate_hz:g} Hz, {CLIENTS} clients: "
    return [
        Row(name + "processor of the gateway for them", "%", shown - alone, f"without clients: {alone:.1f} %", None,
            f"<= {MOST_PERCENT:g} %", shown - alone <= MOST_PERCENT),
        Row(name + "joint states that each gets of each robot", "1/s", rate, "", None, "", None),
        Row(name + "processor after they have gone", "%", after - alone, "", None, "<= 1 %", after - alone <= 1),
    ]  # fmt: skip


def _percent(scene: Scene, seconds: float) -> float:
    before, began_s = cpu_s(scene.gateways[0].pid), time.monotonic()
    time.sleep(seconds)
    return 100 * (cpu_s(scene.gateways[0].pid) - before) / (time.monotonic() - began_s)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=8.0)
    found = rows(parser.parse_args().seconds)
    for row in found:
        print(row)
    return 0 if all(row.holds is not False for row in found) else 1


if __name__ == "__main__":
    sys.exit(main())
