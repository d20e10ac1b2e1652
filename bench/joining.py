"""The cost of joining robots: of all at once, and of one more beside many."""

import argparse
import os
import statistics
import time
from collections.abc import Callable, Sequence

import fake_robots
from bench.crowd import Gateway, Scene, Size, stage
from bench.scene import cpu_s, pid_of
from bench.synthetic import name_of
from bench.table import Row, known
from running import PATIENCE_S, process

ALREADY = (10, 100, 1000)
MOST_S = 10.0
_JOINING, _ROUNDS, _PAUSE_S, _SETTLED_S = 50, 3, 0.3, 1.0


def rows(seconds: float, already: Sequence[int] = ALREADY) -> list[Row]:
    """Return the rows of joining. ``seconds`` is ignored, because each robot joins once.

    Processor times of the gateway cover all threads.
    """
    found, ours, zenoh = list[Row](), list[float](), list[float]()
    for robots in already:
        with stage(Size(robots=robots, joints=18, models=20), 1) as scene:
            took = _all(scene)
            ours.append(_one_more(scene, scene.gateways[0].pid, lambda name, one=scene.gateways[0]: _serves(one, name)))
            zenoh.append(_greeted(scene))
        if robots == already[-1]:
            name = f"{robots} robots join until all can be browsed"
            found.append(Row(name, "s", took, "", None, f"<= {MOST_S:g} s", took <= MOST_S))
        name, where = f"one joins {robots} robots: processor", f"where there are {already[0]}"
        if len(ours) == 1:
            found += [known(name, "ms", ours[0]), known(f"{name} of Zenoh alone", "ms", zenoh[0])]
        else:
            ratio = ours[-1] / ours[0]
            found += [
                Row(name, "ms", ours[-1], f"{ours[0]:.2f} ms {where}", ratio, "the same", ratio < 1.5),
                known(f"{name} of Zenoh alone", "ms", zenoh[-1], f"{zenoh[0]:.2f} ms {where}", zenoh[0]),
            ]
    return found


def _all(scene: Scene) -> float:
    """Return the seconds from the first token until each robot has a value, polled ten times a second."""
    scene.crowd.ask("rate 1")
    first_ns: int = scene.crowd.ask("appear")["first_ns"]
    scene.gateways[0].meet(scene.size.robots)
    scene.crowd.ask("rate 0")
    return (time.monotonic_ns() - first_ns) / 1e9


def _greeted(scene: Scene) -> float:
    with process("-m", "bench.greeter", scene.endpoint) as greeter:
        greeter.said(f"met {name_of(scene.size.robots - 1)}\n")
        return _one_more(scene, pid_of(greeter), lambda name: f"met {name}\n" in greeter.lines)


def _serves(one: Gateway, robot: str) -> bool:
    return one.http.get(f"http://127.0.0.1:{one.port}/{robot}/elbow").status_code == 200


def _one_more(scene: Scene, pid: int, knows: Callable[[str], bool]) -> float:
    """Return the milliseconds for each robot that joins alone; the median of some rounds.

    No frames come meanwhile, and other work of the gateway is subtracted.
    """
    costs = list[float]()
    time.sleep(_SETTLED_S)
    idle, begin = cpu_s(pid), time.monotonic()
    time.sleep(1.0)
    idle_share = (cpu_s(pid) - idle) / (time.monotonic() - begin)
    for number in range(_ROUNDS):
        with fake_robots.open_session(scene.endpoint) as session:
            time.sleep(_SETTLED_S)  # the robots of the round before have left, and a session has come
            before, begin = cpu_s(pid), time.monotonic()
            there = [fake_robots.FakeRobot(session, f"late-{pid}-{number}-{each}") for each in range(_JOINING)]
            for each in there:
                each.appear()
            while not knows(there[-1].name):  # polling must not dominate the measurement
                assert time.monotonic() < begin + PATIENCE_S, "the last one never came"
                time.sleep(_PAUSE_S)
            spent_s = cpu_s(pid) - before - idle_share * (time.monotonic() - begin)
        costs.append(spent_s / _JOINING * 1e3)
    return statistics.median(costs)


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f} before")
    for row in rows(0):
        print(row)


if __name__ == "__main__":
    main()
