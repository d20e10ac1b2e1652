"""HTTP/1.1, 2 and 3 through the front, and Zenoh over TCP and QUIC, on a network with delay and with loss."""

import contextlib
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from certificates import made
from running import PATIENCE_S, ROOT, free_port

from bench.beside import Wire, wire
from bench.front import Front, front, program
from bench.lossy import Network, lossy
from bench.scene import Mover, scene
from bench.table import Row, known, percentile

DELAY_MS = 10.0
"""Each way; a round trip is twice as long."""
LOSSES = (0.0, 0.02)
STREAMS, EVENTS_HZ, STATES_HZ = 10, 20.0, 100.0
_HTTP = {1: "HTTP/1.1", 2: "HTTP/2", 3: "HTTP/3"}
_ZENOH = {"tls": "TCP", "quic": "QUIC"}
_ENDS = ("gateway", "agents/robot")


def rows(seconds: float, losses: Sequence[float] = LOSSES) -> list[Row]:
    return [*_web(seconds, losses), *_wire(seconds, losses)]


def _web(seconds: float, losses: Sequence[float]) -> Iterator[Row]:
    """Ten values of ten robots: read at once on a new connection, then followed as event streams."""
    program()
    with scene("--requests-per-client", "0") as place, contextlib.ExitStack() as robots:
        movers = [robots.enter_context(place.robot(f"mover{n}", EVENTS_HZ)) for n in range(STREAMS)]
        for loss in losses:
            with lossy(DELAY_MS, loss) as network, front(network.here, free_port(), place.place.port) as before:
                found = {name: _asked(version, seconds, network, before) for version, name in _HTTP.items()}
            for name, said in found.items():
                yield from _of_http(name, loss, said, found["HTTP/1.1"], movers)


def _asked(version: int, seconds: float, network: Network, before: Front) -> dict[str, Any]:
    paths = [f"/mover{n}/elbow/rotation" for n in range(STREAMS)]
    where = (str(version), before.address, str(before.port), str(before.authority), str(seconds))
    command = (sys.executable, *network.python("-m", "bench.far", *where, *paths))
    said = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, check=True, timeout=PATIENCE_S).stdout  # noqa: S603
    found: dict[str, Any] = json.loads(said)
    return found


def _of_http(
    name: str, loss: float, said: dict[str, Any], first: dict[str, Any], movers: Sequence[Mover]
) -> Iterator[Row]:
    def late(found: dict[str, Any]) -> list[float]:
        return [ms for mover, seen in zip(movers, found["seen"], strict=True) for ms in mover.latencies_ms([seen])]

    beside = "" if said is first else "HTTP/1.1"
    for what, own, other in (
        ("GETs on a new connection, p50", *(percentile(each["read_ms"], 0.5) for each in (said, first))),
        ("event streams, p50", *(percentile(late(each), 0.5) for each in (said, first))),
        ("event streams, p99", *(percentile(late(each), 0.99) for each in (said, first))),
    ):
        yield known(f"{name}, {loss:.0%} loss: {STREAMS} {what}", "ms", own, beside, other)


def _wire(seconds: float, losses: Sequence[float]) -> Iterator[Row]:
    """States of a robot that come to the gateway, and questions that go from there. Both ends prove who they are."""
    for loss in losses:
        with lossy(DELAY_MS, loss) as network, tempfile.TemporaryDirectory() as folder:
            made(Path(folder), "--agent", "robot", "--gateway", network.here)
            found = {name: _said(kind, seconds, network, Path(folder)) for kind, name in _ZENOH.items()}
        for name, said in found.items():
            yield from _of_zenoh(name, loss, said, found["TCP"])


def _of_zenoh(name: str, loss: float, said: Wire, first: Wire) -> Iterator[Row]:
    beside = "" if said is first else "Zenoh over TCP"
    for what, own, other in (
        ("a state", said.states_ms, first.states_ms),
        ("question and answer", said.answers_ms, first.answers_ms),
    ):
        for word, share in (("p50", 0.5), ("p99", 0.99)):
            said_of = f"Zenoh over {name}, {loss:.0%} loss: {what}, {word}"
            yield known(said_of, "ms", percentile(own, share), beside, percentile(other, share))


def _said(kind: str, seconds: float, network: Network, folder: Path) -> Wire:
    ca = str(folder / "ca.pem")
    here, there = ((ca, *(str(folder / f"{end}.{kind}") for kind in ("pem", "key"))) for end in _ENDS)
    return wire(f"{kind}/{network.here}:{free_port()}", STATES_HZ, seconds, network.python, here, there)
