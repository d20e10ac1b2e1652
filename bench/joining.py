"""What robots that join cost: all of them at once, and one more where there are many already."""

import argparse
import os
import time
from collections.abc import Sequence

import actor
from running import PATIENCE_S

from bench.crowd import Scene, Size, stage
from bench.scene import cpu_s
from bench.table import Row

ALREADY = (10, 100, 1000)
MOST_S = 10.0
_JOINING, _PAUSE_S = 50, 0.3


def rows(seconds: float, already: Sequence[int] = ALREADY) -> list[Row]:
    """``seconds`` is of no matter: each robot joins once. Processor time of the gateway, all threads."""
    found, costs = list[Row](), list[float]()
    for robots in already:
        with stage(Size(robots=robots, joints=18, models=20), 1) as scene:
            took = _all(scene)
            costs.append(_one_more(scene))
        if robots == already[-1]:
            found.append(
                Row(
                    f"{robots} robots join until all can be browsed",
                    "s",
                    took,
                    "",
                    None,
                    f"<= {MOST_S:g} s",
                    took <= MOST_S,
                )
            )
        name, ratio = f"one joins {robots} robots: processor", costs[-1] / costs[0]
        beside = f"{costs[0]:.2f} ms where there are {already[0]}"
        found.append(
            Row(name, "ms", costs[-1], beside, ratio, "the same", ratio < 1.5)
            if len(costs) > 1
            else Row(name, "ms", costs[-1], "", None, "", None)
        )
    return found


def _all(scene: Scene) -> float:
    """From the first token until each robot has a value, in seconds; asked ten times a second."""
    scene.crowd.ask("rate 1")
    first_ns: int = scene.crowd.ask("appear")["first_ns"]
    scene.gateways[0].meet(scene.size.robots)
    return (time.monotonic_ns() - first_ns) / 1e9


def _one_more(scene: Scene) -> float:
    """Milliseconds for each of several, one after another, while no frames come; what else goes on is taken off."""
    one = scene.gateways[0]
    scene.crowd.ask("rate 0")
    time.sleep(0.5)
    idle, begin = cpu_s(one.pid), time.monotonic()
    time.sleep(1.0)
    idle_share = (cpu_s(one.pid) - idle) / (time.monotonic() - begin)
    with actor.stage(scene.endpoint) as session:
        before, begin = cpu_s(one.pid), time.monotonic()
        there = [actor.Actor(session, f"late-{number}") for number in range(_JOINING)]
        for each in there:
            each.appear()
        last = f"http://127.0.0.1:{one.port}/late-{_JOINING - 1}/elbow"
        while one.http.get(last).status_code != 200:  # not so often that asking is what is measured
            assert time.monotonic() < begin + PATIENCE_S, "the last one never came"
            time.sleep(_PAUSE_S)
        spent_s = cpu_s(one.pid) - before - idle_share * (time.monotonic() - begin)
    return spent_s / _JOINING * 1e3


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f} before")
    for row in rows(0):
        print(row)


if __name__ == "__main__":
    main()
