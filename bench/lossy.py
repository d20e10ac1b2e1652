"""A network with delay and loss: a network namespace, and a link to it that a process carries packet by packet.

``python -m bench.lossy NAME HERE THERE HERE-ADDRESS THERE-ADDRESS DELAY-MS LOSS`` runs until its input ends. It needs
root and /dev/net/tun, but no rare kernel module (such as ``sch_netem``).
"""

import contextlib
import fcntl
import heapq
import os
import random
import select
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from bench.table import UnavailableError

ROOT = Path(__file__).resolve().parents[1]

_TUNSETIFF, _TUN, _NO_PREFIX = 0x400454CA, 0x0001, 0x1000
_PACKET = 65_536
_SEED = 20_260


@dataclass(frozen=True)
class Network:
    """A link to the network namespace ``name``. ``here`` and ``there`` are the addresses of its two ends."""

    name: str
    here: str
    there: str

    def python(self, *arguments: str) -> tuple[str, ...]:
        """Return the command that runs Python with these arguments at the far end."""
        return ("tests/support/in_namespace.py", self.name, *arguments)


@contextlib.contextmanager
def lossy(delay_ms: float, loss: float) -> Iterator[Network]:
    """Delay each packet by ``delay_ms`` in each direction, and lose it with the probability ``loss``."""
    number = os.getpid() % 250 + 1
    name, ends = f"lb{os.getpid()}", (f"lbh{os.getpid()}", f"lbt{os.getpid()}")
    # Addresses for documentation (RFC 5737), which nothing real has.
    found = Network(name, f"198.51.100.{number}", f"203.0.113.{number}")
    said = (name, *ends, found.here, found.there, str(delay_ms), str(loss))
    carrier = subprocess.Popen(  # noqa: S603
        [sys.executable, "-m", "bench.lossy", *said], cwd=ROOT, env={**os.environ, "PYTHONPATH": "."},
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert carrier.stdout is not None and carrier.stderr is not None
        if carrier.stdout.readline() != "ready\n":
            raise UnavailableError(
                f"no network of our own here, which needs to be root: {carrier.stderr.read().strip()[-200:]}"
            )
        yield found
    finally:
        carrier.communicate()


def main() -> None:
    name, here, there, address, far_address = sys.argv[1:6]
    delay_s, loss = float(sys.argv[6]) / 1e3, float(sys.argv[7])
    with contextlib.ExitStack() as undo:
        _ip("netns", "add", name)
        undo.callback(_ip, "netns", "del", name)
        near, far = _tun(here), _tun(there)
        undo.callback(os.close, near)
        undo.callback(os.close, far)
        _ip("link", "set", there, "netns", name)
        _ip("address", "add", f"{address}/32", "peer", f"{far_address}/32", "dev", here)
        _ip("link", "set", here, "up")
        _ip("-n", name, "address", "add", f"{far_address}/32", "peer", f"{address}/32", "dev", there)
        _ip("-n", name, "link", "set", there, "up")
        _ip("-n", name, "link", "set", "lo", "up")
        print("ready", flush=True)
        _carry(near, far, delay_s, loss)


def _carry(near: int, far: int, delay_s: float, loss: float) -> None:
    """Carry packets until standard input ends. With the same order of packets, the same ones are lost."""
    lot = random.Random(_SEED)  # noqa: S311
    under_way: list[tuple[float, int, int, bytes]] = []
    number = 0
    while True:
        pause = max(0.0, under_way[0][0] - time.monotonic()) if under_way else None
        ready, _, _ = select.select((near, far, sys.stdin), (), (), pause)
        if sys.stdin in ready:
            return
        for end in {near, far}.intersection(ready):
            packet = os.read(end, _PACKET)
            number += 1
            if lot.random() >= loss:
                heapq.heappush(under_way, (time.monotonic() + delay_s, number, far if end == near else near, packet))
        while under_way and under_way[0][0] <= time.monotonic():
            *_, end, packet = heapq.heappop(under_way)
            os.write(end, packet)


def _tun(name: str) -> int:
    device = os.open("/dev/net/tun", os.O_RDWR)
    fcntl.ioctl(device, _TUNSETIFF, struct.pack("16sH14x", name.encode(), _TUN | _NO_PREFIX))
    return device


def _ip(*words: str) -> None:
    subprocess.run(("ip", *words), check=True)  # noqa: S603, S607


if __name__ == "__main__":
    main()
