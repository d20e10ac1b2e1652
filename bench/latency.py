"""Latency of a state to a subscriber, beside plain Zenoh."""

import contextlib
import time

from bench.beside import wire
from bench.scene import Readers, scene
from bench.table import Row, at_most, known, percentile
from running import free_port

RATE_HZ = 100


def rows(seconds: float) -> list[Row]:
    """Measure from sending a frame to its WebSocket message, for one robot and one subscriber."""
    raw_ms = wire(f"tcp/127.0.0.1:{free_port()}", RATE_HZ, seconds).states_ms
    with (
        scene() as place,
        place.robot("mover", RATE_HZ) as mover,
        contextlib.closing(Readers(place.place.port, "ws", 1, "/mover/elbow/rotation")) as reader,
    ):
        reader.counted()
        time.sleep(seconds)
        sent_ms = mover.latencies_ms(reader.counted()["seen"])
    name, beside = "from a robot's frame to its subscriber", "Zenoh from process to process"
    return [
        known(f"{beside}, p50", "ms", percentile(raw_ms, 0.5)),
        known(f"{beside}, p99", "ms", percentile(raw_ms, 0.99)),
        at_most(f"{name}, p50", percentile(sent_ms, 0.5), beside, percentile(raw_ms, 0.5), 0.6),
        at_most(f"{name}, p99", percentile(sent_ms, 0.99), beside, percentile(raw_ms, 0.99), 1.5),
    ]
