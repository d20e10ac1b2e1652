"""A fleet behind a tree of Zenoh routers: joins, what gateways and routers keep, cut links, a region that is lost.

Prints tables in Markdown; docs/SCALE.md says what follows from them. It needs root, since every router has a network
namespace of its own, and says so where it cannot have them.
"""

import argparse
import contextlib
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from bench.crowd import Gateway, Size
from bench.machine import machine
from bench.namespaces import Link, full_name, namespaces
from bench.robots import Figures, spread, table
from bench.router_tables import KINDS
from bench.router_tree import AREAS, CORE, HALLS, Tree, growing
from bench.scene import cpu_s, rss_kib
from bench.synthetic import name_of
from bench.table import UnavailableError
from commanding import TURTLE, radian
from redis_servers import cluster_replicated
from running import ROOT

RATE_HZ = 0.25
"""Frame rate: more frequent than the 5 s of silence after which a gateway queries a robot."""
STAYS, LOST = AREAS
SHOWN = (CORE, STAYS, AREAS[STAYS][0])
"""Routers whose figures are shown; others of their levels are like them."""
_ONLINE = re.compile(r'^linked_fleet_robots\{presence="online"\} ([\d.e+]+)$', re.M)
_PATIENCE_S = 600.0
_COMMANDED = 30
_BRIEF_S = 1.0


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.routers", description=__doc__)
    for name, value in (("robots", 10_000), ("joints", 18), ("models", 20), ("requests", 60), ("namespaces", 10)):
        parser.add_argument(f"--{name}", type=int, default=value)
    parser.add_argument("--seconds", type=float, default=8.0, help="of each measurement")
    parser.add_argument("--minutes", type=float, default=6.0, help="it is stopped after that time")
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if not arguments.inside:
        return _in_a_namespace(arguments.minutes)
    size = Size(
        arguments.robots, arguments.joints, arguments.models, arguments.seconds, arguments.requests, [RATE_HZ],
        arguments.namespaces,
    )  # fmt: skip
    on = machine()
    print(f"{size.robots} robots of {size.joints} joints in {size.namespaces} namespaces;", end=" ")
    print(f"{on['processors']} processors ({on['processor']}), where the load was {on['load before']} before\n")
    for columns in measure(size):
        print(table(columns), end="\n\n", flush=True)
    return 0


def _in_a_namespace(minutes: float) -> int:
    """Run this again where it can make links, for no longer than that, and remove all namespaces at the end."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # else it would end without removing anything
    try:
        with namespaces() as environment:
            command = [sys.executable, "tests/in_namespace.py", full_name("hub"), "-m", "bench.routers", "--inside"]
            limit_s = minutes * 60
            return subprocess.run(  # noqa: S603
                [*command, *sys.argv[1:]], cwd=ROOT, env=environment, check=False, timeout=limit_s
            ).returncode
    except UnavailableError as error:
        print(f"skipped: {error}")
        return 0
    except subprocess.TimeoutExpired:
        print(f"stopped after {minutes:g} minutes; a smaller fleet, or --minutes, lets it end")
        return 1


def measure(size: Size) -> Iterator[Mapping[str, Figures]]:
    """Yield figures of gateways, of routers, and of faults."""
    with (
        tempfile.TemporaryDirectory() as folder,
        cluster_replicated(Path(folder, "redis")) as store,
        growing(Path(folder), size, store) as tree,
    ):
        gateways, routers = joining(tree)
        for at, found in resting(tree).items():
            (gateways if at in gateways else routers)[at] |= found
        for at, found in commands(tree).items():
            gateways[at] |= found
        yield {f"gateway at {at}": found for at, found in gateways.items()}
        yield {f"router of {at}": routers[f"router {at}"] for at in SHOWN}
        yield {"seen at the core": brief_cut(tree) | long_cut(tree) | lost_region(tree)}


@dataclass
class Spent:
    """Counters of all parts at one moment: processor time, s; memory, KiB; bytes to gateways and to routers above."""

    cpu_s: dict[str, float]
    rss_kib: dict[str, int]
    to_gateway: dict[str, int]
    north: dict[str, int]


def spent(tree: Tree) -> Spent:
    pids = {at: one.pid for at, one in tree.gateways.items()}
    pids |= {f"router {name}": tree.sites[name].pid for name in SHOWN}
    return Spent(
        {name: cpu_s(pid) for name, pid in pids.items()},
        {name: rss_kib(pid) for name, pid in pids.items()},
        {at: tree.uplinks[at].carried_bytes()[1] for at in tree.gateways},
        {name: site.north.carried_bytes()[1] for name in SHOWN if (site := tree.sites[name]).north is not None},
    )


def seen(tree: Tree) -> int:
    """Return the number of robots that a gateway has: those of the first namespace."""
    return tree.size.robots // tree.size.namespaces


def joining(tree: Tree) -> tuple[dict[str, Figures], dict[str, Figures]]:
    """Let all robots join at once. Return figures of gateways and of routers, by name."""
    robots, before = seen(tree), spent(tree)
    first_ns = tree.appear(HALLS, RATE_HZ)
    appeared_s = (time.monotonic_ns() - first_ns) / 1e9
    with ThreadPoolExecutor() as pool:
        known_ns = dict(
            zip(tree.gateways, pool.map(lambda one: _until(one, robots), tree.gateways.values()), strict=True)
        )
    after = spent(tree)

    def each(what: Callable[[Spent], Mapping[str, float]], name: str, among: int) -> float:
        return (what(after)[name] - what(before)[name]) / among

    declared = {at: tree.sites[at].known()[tree.uplinks[at].address] for at in tree.gateways}
    gateways = {
        at: {
            "joining: until the last robot has declared itself, s": f"{appeared_s:.1f}",
            "— until all can be browsed, s": f"{(known_ns[at] - first_ns) / 1e9:.1f}",
            "— CPU a robot, ms": f"{each(lambda said: said.cpu_s, at, robots) * 1e3:.2f}",
            "— received a robot, kB": f"{each(lambda said: said.to_gateway, at, robots) / 1e3:.1f}",
            "declares: tokens, queryables, subscribers": _declared(declared[at]),
            "keeps: robots": f"{online(tree.gateways[at])}",
            "— memory with none, MiB": f"{before.rss_kib[at] / 1024:.0f}",
            "— memory a robot, kB": f"{each(lambda said: said.rss_kib, at, robots) * 1.024:.1f}",
        }
        for at in tree.gateways
    }
    routers, fleet = {}, tree.size.robots
    for site in SHOWN:
        name = f"router {site}"
        routers[name] = {
            "knows: tokens, queryables, subscribers": _declared(tree.sites[site].known()["all"]),
            "memory with no robot, MiB": f"{before.rss_kib[name] / 1024:.0f}",
            "— more for each of the fleet, kB": f"{each(lambda said: said.rss_kib, name, fleet) * 1.024:.1f}",
            "joining: CPU for each of the fleet, ms": f"{each(lambda said: said.cpu_s, name, fleet) * 1e3:.2f}",
        }
        if site in before.north:
            sent = f"{each(lambda said: said.north, site, fleet) / 1e3:.1f}"
            routers[name]["— sent to the router above for each of the fleet, kB"] = sent
    return gateways, routers


def resting(tree: Tree) -> dict[str, Figures]:
    """Measure frames without readers."""
    before, begin = spent(tree), time.monotonic()
    time.sleep(tree.size.seconds)
    after, took_s = spent(tree), time.monotonic() - begin
    found = {}
    for name in before.cpu_s:
        found[name] = {
            f"{RATE_HZ:g} Hz: CPU, %": f"{(after.cpu_s[name] - before.cpu_s[name]) / took_s * 100:.0f}",
        }
        site = name.removeprefix("router ")
        if name in before.to_gateway:
            received = (after.to_gateway[name] - before.to_gateway[name]) / took_s
            found[name]["— received, kB/s"] = f"{received / 1e3:.0f}"
        elif site in before.north:
            found[name]["— sent to the router above, kB/s"] = (
                f"{(after.north[site] - before.north[site]) / took_s / 1e3:.0f}"
            )
    return found


def commands(tree: Tree) -> dict[str, Figures]:
    """Measure from the POST to the agent's acceptance, for robots of all halls in turn."""
    found = {}
    for at in tree.gateways:
        took = []
        for number in range(tree.size.requests):
            begin = time.perf_counter()
            status = rotated(tree, at, number * 7919 % seen(tree))
            assert status == 204, status
            took.append((time.perf_counter() - begin) * 1e3)
        found[at] = {"command, from POST to acceptance, p50 / p99, ms": spread(took)}
    return found


# -- faults, as the gateway at the core sees them ---------------------------------------------------------------------


def brief_cut(tree: Tree) -> Figures:
    """Cut the link of an area for less than the lease of a connection."""
    north = _north_of_lost(tree)
    north.cut()
    time.sleep(_BRIEF_S)
    north.heal()
    least, end = seen(tree), time.monotonic() + tree.size.seconds
    while time.monotonic() < end:
        least = min(least, online(tree.gateways[CORE]))
        time.sleep(0.2)
    return {f"link of an area cut for {_BRIEF_S:g} s: robots that went offline": f"{seen(tree) - least}"}


def long_cut(tree: Tree) -> Figures:
    """Cut the link of an area until all of its robots are offline at the core, then heal it."""
    robots, north = seen(tree), _north_of_lost(tree)
    begin_ns = time.monotonic_ns()
    north.cut()
    offline_ns = _until(tree.gateways[CORE], robots // 2)
    own = online(tree.gateways[LOST])
    status = rotated(tree, LOST, robots - 1)
    begun_ns = time.monotonic_ns()
    north.heal()
    back = {at: (_until(one, robots) - begun_ns) / 1e9 for at, one in tree.gateways.items()}
    said = "link of an area cut until its robots are offline: "
    return {
        said + "after, s": f"{(offline_ns - begin_ns) / 1e9:.1f}",
        "— robots of the area online at its own gateway meanwhile": f"{own}",
        "— a command there meanwhile: status": f"{status}",
        "— healed: until all are back at all gateways, s": f"{max(back.values()):.1f}",
    }


def lost_region(tree: Tree) -> Figures:
    """Kill an area, its halls, robots, gateway and Redis master at once, and restart them."""
    robots, halls = seen(tree), AREAS[LOST]
    begin_ns = time.monotonic_ns()
    tree.store.nodes[-1].kill()
    tree.kill(LOST)
    for name in (LOST, *halls):
        tree.sites[name].kill()
    with ThreadPoolExecutor() as pool:
        offline = pool.submit(_until, tree.gateways[CORE], robots // 2)
        accepted = pool.submit(_accepted, tree)
        offline_s, elsewhere = (offline.result() - begin_ns) / 1e9, online(tree.gateways[CORE])
        accepted_ns, refused = accepted.result()
    begun_ns = time.monotonic_ns()
    tree.store.nodes[-1].start()
    for name in (LOST, *halls):
        tree.sites[name].start()
    tree.start(LOST)
    tree.populate(halls)
    tree.appear(halls, RATE_HZ)
    declared_s = (time.monotonic_ns() - begun_ns) / 1e9
    with ThreadPoolExecutor() as pool:
        back_ns = dict(
            zip(tree.gateways, pool.map(lambda one: _until(one, robots), tree.gateways.values()), strict=True)
        )
    stayed_s, own_s = (
        (max(at_ns for at, at_ns in back_ns.items() if (at == LOST) == own) - begun_ns) / 1e9 for own in (False, True)
    )
    return {
        "area lost, with its gateway and a Redis master: until its robots are offline, s": f"{offline_s:.1f}",
        "— robots elsewhere that are online then": f"{elsewhere}",
        f"— until each of {_commanded(tree)} robots elsewhere has accepted a command, s": (
            f"{(accepted_ns - begin_ns) / 1e9:.1f}"
        ),
        "— commands refused or not answered until then": f"{refused}",
        "— back: until its processes run and its robots have declared themselves, s": f"{declared_s:.1f}",
        "— until all robots are at the gateways that stayed, s": f"{stayed_s:.1f}",
        "— until all robots are at its own gateway, s": f"{own_s:.1f}",
    }


def _north_of_lost(tree: Tree) -> Link:
    north = tree.sites[LOST].north
    assert north is not None
    return north


def _commanded(tree: Tree) -> int:
    """Return how many robots get commands when a region is lost; the first half of the numbers are of the other one."""
    return min(_COMMANDED, seen(tree) // 2)


def _accepted(tree: Tree) -> tuple[int, int]:
    """Command robots elsewhere until each has accepted once. Return when that was, and how many commands failed."""
    waiting, refused = set(range(_commanded(tree))), 0
    deadline = time.monotonic() + _PATIENCE_S
    while waiting:
        for number in sorted(waiting):
            if rotated(tree, CORE, number) == 204:
                waiting.discard(number)
            else:
                refused += 1
        assert time.monotonic() < deadline, f"{len(waiting)} robots take no command"
    return time.monotonic_ns(), refused


# -- what is asked of a gateway ---------------------------------------------------------------------------------------


def online(one: Gateway) -> int:
    found = _ONLINE.search(one.get("/metrics", "*/*").text)
    return round(float(found[1])) if found else 0


def rotated(tree: Tree, at: str, number: int) -> int:
    """Return the status of the answer to a motion of the robot with this number among those of a gateway."""
    one = tree.gateways[at]
    url = f"http://127.0.0.1:{one.port}/{name_of(number * tree.size.namespaces)}/joint_1/actions/rotate"
    return one.http.post(url, content=radian(0.2), headers=TURTLE).status_code


def _until(one: Gateway, robots: int) -> int:
    """Return when exactly so many robots are online (CLOCK_MONOTONIC, ns); asked twice a second at most."""
    deadline = time.monotonic() + _PATIENCE_S
    while (found := online(one)) != robots:
        assert time.monotonic() < deadline, f"{found} robots are online, and never {robots}"
        time.sleep(0.5)
    return time.monotonic_ns()


def _declared(found: Mapping[str, int]) -> str:
    return ", ".join(f"{found.get(kind, 0):,}" for kind in KINDS)


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        sys.exit(main())
