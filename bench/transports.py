"""HTTP/1.1, 2 and 3 through the front, on a network with delay and with loss."""

import contextlib
import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from typing import Any

from bench.front import Front, front, program
from bench.lossy import Network, lossy
from bench.scene import Mover, scene
from bench.table import Row, known, percentile
from running import PATIENCE_S, ROOT, free_port

DELAY_MS = 10.0
"""In each direction; a round trip takes twice as long."""
LOSSES = (0.0, 0.02)
STREAMS, RATE_HZ = 10, 20.0
_HTTP = {1: "HTTP/1.1", 2: "HTTP/2", 3: "HTTP/3"}


def rows(seconds: float, losses: Sequence[float] = LOSSES) -> list[Row]:
    return list(_measured(seconds, losses))


def _measured(seconds: float, losses: Sequence[float]) -> Iterator[Row]:
    """Measure ten values of ten robots: read at once on a new connection, then followed as event streams."""
    program()
    with scene("--requests-per-client", "0") as place, contextlib.ExitStack() as robots:
        movers = [robots.enter_context(place.robot(f"mover{n}", RATE_HZ)) for n in range(STREAMS)]
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

    beside, both = "" if said is first else "HTTP/1.1", (said, first)
    read_ms, late_ms = [each["read_ms"] for each in both], [late(each) for each in both]
    for what, values, share in (
        ("GETs on a new connection, p50", read_ms, 0.5),
        ("event streams, p50", late_ms, 0.5),
        ("event streams, p99", late_ms, 0.99),
    ):
        own, other = (percentile(each, share) for each in values)
        yield known(f"{name}, {loss:.0%} loss: {STREAMS} {what}", "ms", own, beside, other)
