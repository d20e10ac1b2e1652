"""The footprint of a gateway and an agent: memory at rest, memory per robot, processor time of an agent."""

import argparse
import contextlib
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator

from bench.crowd import Scene, Size, stage
from bench.scene import cpu_s, rss_kib
from bench.synthetic import name_of
from bench.table import Row

SIZE = Size(robots=200, joints=60, models=20, rates_hz=(1,))
JOINTS, RATE_HZ = 20, 100.0
_FRAME_BYTES = 40 + 3 * 8 * JOINTS
MOST_MB, MOST_KB, MOST_AGENT_MB, MOST_AGENT_PERCENT = 64.0, 300.0, 40.0, 3.0
# The libraries of the gateway and a listening Zenoh session, without the gateway's own code.
LIBRARIES = """
import asyncio, json, sys
import h11, msgspec, pyoxigraph, redis.asyncio, starlette.applications, uvicorn, uvloop, websockets, zenoh
from linked_fleet_link.zenoh_session import settings
config = zenoh.Config()
for name, value in settings(("tcp/127.0.0.1:0",), (), {}).items():
    config.insert_json5(name, json.dumps(value))
with zenoh.open(config):
    print("open", flush=True)
    sys.stdin.read()
"""
# The minimum of an agent: it wakes up and publishes a constant frame.
_TIMER = """
import asyncio, sys
import zenoh
from linked_fleet_agent.zenoh_session import configuration
from linked_fleet_agent.wire.keys import Keys
endpoint, period_s, payload = sys.argv[1], 1.0 / float(sys.argv[2]), bytes(int(sys.argv[3]))
async def main():
    loop = asyncio.get_running_loop()
    def due():
        publisher.put(payload)
        loop.call_at(loop.time() + period_s, due)
    due()
    print("runs", flush=True)
    await asyncio.to_thread(sys.stdin.read)
with zenoh.open(configuration((endpoint,), (), 2_000)) as session:
    drop = zenoh.CongestionControl.DROP
    publisher = session.declare_publisher(Keys().robot("timer", "state"), congestion_control=drop)
    asyncio.run(main())
"""


def rows(seconds: float, size: Size = SIZE) -> list[Row]:
    """Return memory as resident set size, shared files included."""
    with stage(size, 1) as scene:
        empty, floor = rss_kib(scene.gateways[0].pid), _floor_kib()
        grown = _grown_kib(scene)
        bare, _ = _spent(seconds, "-c", _TIMER, scene.endpoint, str(RATE_HZ), str(_FRAME_BYTES))
        percent, agent_kib = _spent(seconds, "-m", "bench.still_agent", scene.endpoint, str(JOINTS), str(RATE_HZ))
    rest, parts, agent = empty * 1.024e-3, floor * 1.024e-3, agent_kib * 1.024e-3
    each = grown * 1.024 / size.robots
    return [
        Row("gateway with nobody: memory", "MB", rest, f"its libraries and a Zenoh session alone: {parts:.0f} MB",
            rest / parts, f"<= {MOST_MB:g} MB", rest <= MOST_MB),
        Row(f"gateway: memory for a robot of {size.joints} joints that was read once", "kB", each, "", None,
            f"<= {MOST_KB:g} kB", each <= MOST_KB),
        Row(f"agent of {JOINTS} joints at {RATE_HZ:g} Hz: memory", "MB", agent, "", None, f"<= {MOST_AGENT_MB:g} MB",
            agent <= MOST_AGENT_MB),
        Row(f"agent of {JOINTS} joints at {RATE_HZ:g} Hz: processor", "%", percent,
            f"a timer that publishes a ready frame: {bare:.1f} %", percent / bare,
            f"<= {MOST_AGENT_PERCENT:g} %", percent <= MOST_AGENT_PERCENT),
    ]  # fmt: skip


def _grown_kib(scene: Scene) -> int:
    """Return the growth of the gateway's memory (KiB) by all robots, after each was read once."""
    one = scene.gateways[0]
    before = rss_kib(one.pid)
    scene.crowd.ask("rate 1")
    scene.crowd.ask("appear")
    one.meet(scene.size.robots)
    for number in range(scene.size.robots):
        one.get(f"/{name_of(number)}/")
    return rss_kib(one.pid) - before


def _floor_kib() -> int:
    with _child("-c", LIBRARIES) as pid:
        return rss_kib(pid)


def _spent(seconds: float, *arguments: str) -> tuple[float, int]:
    """Return the usage of a running child: percent of a processor, and KiB. Medians of five runs."""
    with _child(*arguments) as pid:
        time.sleep(1.0)
        found = [_percent(pid, seconds) for _ in range(5)]
        return statistics.median(found), rss_kib(pid)


def _percent(pid: int, seconds: float) -> float:
    cpu, begin = cpu_s(pid), time.monotonic()
    time.sleep(seconds)
    return (cpu_s(pid) - cpu) / (time.monotonic() - begin) * 100


@contextlib.contextmanager
def _child(*arguments: str) -> Iterator[int]:
    """Run a process that prints one line when it is ready, and ends when its input ends."""
    child = subprocess.Popen([sys.executable, *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE)  # noqa: S603
    assert child.stdin is not None and child.stdout is not None
    try:
        assert child.stdout.readline(), "it ended at once"
        yield child.pid
    finally:
        child.stdin.close()
        child.wait()
        child.stdout.close()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=5.0)
    asked = parser.parse_args()
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f} before")
    for row in rows(asked.seconds):
        print(row)


if __name__ == "__main__":
    main()
