"""``python -m fuzzing.soak``: everything at once for a long time, with faults, at a rate for two cores.

Two gateways with one Zenoh router and one Redis, a simulated arm, a robot with a stepping value, robots that come and
go. Clients read, move, subscribe in every way and unsubscribe. One after another, with pauses, an agent, Redis and one
of the gateways are killed and restarted; the other gateway always runs, and its memory is watched.
"""

import argparse
import contextlib
import itertools
import signal
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import httpx

from bench.scene import pid_of, rss_kib
from browser import LF
from commanding import ENDED, WRIST, all_see, of_joint
from fuzzing.living import WRONG
from fuzzing.workers import Churn, Clients, Hops, Motions, Reads, Steps, TransientRobots, agent
from gateway_group import Gateway, Hub, arrived, deliveries, gateway, hub
from load import EventFollower, Follower, Front, SocketFollower, going_on
from receivers import CallbackReceiver, receiving
from redis_servers import Server, single
from running import Process, eventually, free_port

GROWTH_KIB = 32 * 1024
"""Limit of the growth of the running gateway's memory after the warm-up, by the fitted line."""
WARM_UP = 0.3
"""Share of the total time."""
SAMPLE_S = 2.0
REST_S = 8.0


class Soak:
    """The processes, and what must hold after each fault."""

    def __init__(self, stage: Hub, redis: Server, stack: contextlib.ExitStack) -> None:
        self.stage, self.redis, self._stack = stage, redis, stack
        self.done: Counter[str] = Counter()
        self.processes: list[tuple[str, Process]] = []
        self.ports = [free_port(), free_port()]
        self.gateways = [self._gateway(index) for index in range(2)]
        self.arm = self._arm()
        all_see(self.gateways)

    @property
    def steady(self) -> Process:
        return self.gateways[0].process

    def kill_gateway(self) -> None:
        self._replace_gateway(signal.SIGKILL)

    def end_gateway(self) -> None:
        self._replace_gateway(signal.SIGTERM)

    def kill_redis(self) -> None:
        self.redis.kill()
        time.sleep(1.0)
        self.redis.start()

    def kill_agent(self) -> None:
        self.arm.send(signal.SIGKILL)
        self.arm.ended()
        self.arm = self._arm()
        all_see(self.gateways)

    def hang_agent(self) -> None:
        """Stop the agent for longer than its lease."""
        self.arm.send(signal.SIGSTOP)
        time.sleep(4.0)
        self.arm.send(signal.SIGCONT)
        all_see(self.gateways)

    def _replace_gateway(self, by: signal.Signals) -> None:
        self.gateways[1].process.send(by)
        self.gateways[1].process.ended()
        self.gateways[1] = self._gateway(1)
        all_see(self.gateways)

    def _gateway(self, index: int) -> Gateway:
        made = gateway(self.stage, "--redis-url", self.redis.url, port=self.ports[index])
        one = self._stack.enter_context(made)
        self.processes.append((f"gateway {index}", one.process))
        return one

    def _arm(self) -> Process:
        one = self._stack.enter_context(agent(self.stage.endpoint))
        self.processes.append(("agent", one))
        return one


class Memory:
    """Samples of a process's resident memory."""

    def __init__(self, child: Process) -> None:
        self._child, self._begin = child, time.monotonic()
        self.samples: list[tuple[float, float]] = []

    def __call__(self, over: threading.Event) -> None:
        self.samples.append((time.monotonic() - self._begin, float(rss_kib(pid_of(self._child)))))
        over.wait(SAMPLE_S)

    def growth_kib(self) -> float:
        """Return the growth of the least-squares line from the end of the warm-up to the last sample."""
        last_s = self.samples[-1][0]
        kept = [each for each in self.samples if each[0] >= WARM_UP * last_s]
        if len(kept) < 3:
            return 0.0
        times, sizes = zip(*kept, strict=True)
        mean_s, mean_kib = sum(times) / len(kept), sum(sizes) / len(kept)
        spread = sum((each - mean_s) ** 2 for each in times)
        slope = sum((at - mean_s) * (size - mean_kib) for at, size in kept) / spread
        return slope * (times[-1] - times[0])


class Judge:
    """Checks after a fault."""

    def __init__(self, soak: Soak, motions: Motions, churn: Churn, followers: Sequence[Follower], hops: Hops) -> None:
        self._soak, self._motions, self._churn, self._followers, self._hops = soak, motions, churn, followers, hops

    def settled(self) -> None:
        """Check that the arm moves, callbacks are delivered, and every follower gets present values.

        Raises AssertionError.
        """
        moved, made, heard = self._motions.well, self._churn.made, self._hops.heard
        eventually(lambda: self._motions.well > moved + 1, "motions that succeed again")
        eventually(lambda: self._churn.made > made, "a callback that is accepted again")
        eventually(lambda: self._hops.heard > heard + 4, "streams that are opened again, at both gateways")
        step = self._soak.stage.angle
        eventually(lambda: all(each.last > step for each in self._followers), "followers that hear what is new")

    def ended(self, clients: Clients) -> None:
        """Check the end, when nothing moves the robot or the value any more."""
        for iri in self._motions.begun[-200:]:
            eventually(lambda iri=iri: self._over(iri), f"the end of {iri}")  # type: ignore[misc]
        assert not clients.wrong, "\n".join(clients.wrong[:10])

    def _over(self, iri: str) -> bool:
        one = self._soak.gateways[0]
        answer = one.get(one.here(iri))
        if answer.status_code == 404:  # for each robot the last thousand are remembered
            return True
        return one.browser.page(one.here(iri)).one(LF.state) in (*ENDED, LF.unknown)

    def delivered(self, receiver: CallbackReceiver) -> int:
        """Check that every accepted, undeleted callback has the latest value, without gaps; return their number."""
        for path in self._churn.held.values():
            arrived(receiver, path, self._soak.stage.angle)
            deliveries(receiver.log(path, "POST"))
        return len(self._churn.held)


def wrong_in_logs(processes: Sequence[tuple[str, Process]]) -> list[str]:
    return [f"{who}: {line.strip()}" for who, each in processes for line in each.lines if WRONG.search(line)]


def run(minutes: float) -> dict[str, str]:
    """Return results by name; AssertionError for violations."""
    table: dict[str, str] = {}
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        stage, redis = stack.enter_context(hub()), stack.enter_context(single(folder)).nodes[0]
        receiver = stack.enter_context(receiving())
        soak = Soak(stage, redis, stack)
        roots = [f"http://127.0.0.1:{port}/" for port in soak.ports]
        first, action = soak.gateways[0], of_joint(soak.gateways[0].browser, WRIST)
        rotation, container, turn = (httpx.URL(each).path for each in (first.rotation, first.container, action))
        clients = stack.enter_context(contextlib.closing(Clients(roots)))
        fronts = [stack.enter_context(contextlib.closing(Front(each))) for each in (roots, roots[::-1])]
        motions, churn = Motions(clients, turn), Churn(clients, container, rotation, receiver)
        reads, guests = Reads(clients, ("/", "/ur5/", rotation, container, turn)), TransientRobots(stage.session)
        memory, followers = (
            Memory(soak.steady),
            (SocketFollower(fronts[0], rotation), EventFollower(fronts[1], rotation)),
        )
        hops = Hops(roots, rotation)
        judge = Judge(soak, motions, churn, followers, hops)
        begin = time.monotonic()
        with going_on(*followers, wake=stage.step):
            with going_on(motions, churn, reads, hops, guests, memory, Steps(stage), wake=stage.step):
                _faults(soak, judge, begin + 60 * minutes)
            judge.ended(clients)
            stage.step()
            eventually(lambda: all(each.last == stage.angle for each in followers), "the latest value")
        table["callbacks that have the latest value"] = str(judge.delivered(receiver))
        took_s = time.monotonic() - begin
        table |= {f"faults: {name}": str(count) for name, count in soak.done.items()}
        table |= {
            "minutes": f"{took_s / 60:.1f}",
            "motions asked for, begun, done in time": f"{motions.asked}, {len(motions.begun)}, {motions.well}",
            "callbacks made, deleted": f"{churn.made}, {churn.deleted}",
            "deliveries received": str(len(receiver.log(method="POST"))),
            "reads": str(reads.well),
            "robots that came and went": str(guests.came),
            "streams opened, heard and closed": f"{hops.asked}, {hops.heard}",
            "values of the joint": str(stage.steps),
            "memory of the gateway that lives": f"{memory.samples[-1][1] / 1024:.0f} MiB",
            "its growth after the warm-up": f"{memory.growth_kib() / 1024:+.1f} MiB",
        }
    wrong = wrong_in_logs(soak.processes)
    assert not wrong, "\n".join(wrong[:20])
    assert memory.growth_kib() <= GROWTH_KIB, f"the gateway grew by {memory.growth_kib():.0f} KiB"
    return table


def _faults(soak: Soak, judge: Judge, end_s: float) -> None:
    """Cause faults one after another until the end time, at least one."""
    faults: Iterator[Callable[[], None]] = itertools.cycle(
        (soak.kill_gateway, soak.kill_redis, soak.kill_agent, soak.end_gateway, soak.hang_agent)
    )
    judge.settled()
    while True:
        fault = next(faults)
        fault()
        soak.done[fault.__name__.replace("_", " ")] += 1
        judge.settled()
        if time.monotonic() >= end_s:
            return
        time.sleep(min(REST_S, max(0.0, end_s - time.monotonic())))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=60.0)
    minutes = parser.parse_args().minutes
    try:
        table = run(minutes)
    except AssertionError as error:
        print(f"the soak failed: {error}", file=sys.stderr)
        return 1
    for what, figure in table.items():
        print(f"{what:<45}{figure:>20}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
