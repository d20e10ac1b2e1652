"""Zenoh over TCP and over QUIC between processes, on a network with delay and with loss."""

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from bench.beside import Wire, wire
from bench.lossy import Network, lossy
from bench.table import Row, known, percentile
from bench.transports import DELAY_MS, LOSSES
from certificates import made
from running import free_port

RATE_HZ = 100.0
LONGER = 2.0
"""Duration compared to other suites: two of a hundred packets are lost, and a few seconds have some hundred."""
_ZENOH = {"TCP": ("tls", ""), "QUIC": ("quic", ""), "QUIC with datagrams": ("quic", "?mixed_rel=auto")}
_ENDS = ("gateway", "agents/robot")


def rows(seconds: float, losses: Sequence[float] = LOSSES) -> list[Row]:
    return list(_measured(seconds, losses))


def _measured(seconds: float, losses: Sequence[float]) -> Iterator[Row]:
    """Measure states from a robot to the gateway, and questions in the other direction, with mutual TLS."""
    for loss in losses:
        with lossy(DELAY_MS, loss) as network, tempfile.TemporaryDirectory() as folder:
            made(Path(folder), "--agent", "robot", "--gateway", network.here)
            found = {name: _said(*link, seconds, network, Path(folder)) for name, link in _ZENOH.items()}
        for name, said in found.items():
            yield from _of_zenoh(name, loss, said, found["TCP"])


def _of_zenoh(name: str, loss: float, said: Wire, first: Wire) -> Iterator[Row]:
    beside = "" if said is first else "Zenoh over TCP"
    for what, own, other in (
        ("a state", said.states_ms, first.states_ms),
        ("question and answer", said.answers_ms, first.answers_ms),
    ):
        for word, share in (("p50", 0.5), ("p90", 0.9)):
            said_of = f"Zenoh over {name}, {loss:.0%} loss: {what}, {word}"
            yield known(said_of, "ms", percentile(own, share), beside, percentile(other, share))


def _said(kind: str, more: str, seconds: float, network: Network, folder: Path) -> Wire:
    ca = str(folder / "ca.pem")
    here, there = ((ca, *(str(folder / f"{end}.{suffix}") for suffix in ("pem", "key"))) for end in _ENDS)
    return wire(f"{kind}/{network.here}:{free_port()}{more}", RATE_HZ, seconds * LONGER, network.python, here, there)
