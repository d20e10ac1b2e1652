"""A fleet behind a tree of Zenoh routers: joins, what gateways and routers keep, cut links, a region that is lost.

Prints tables in Markdown; docs/SCALE.md says what follows from them. It needs root, since every router has a network
namespace of its own, and says so where it cannot have them.

  joining, ... at a time  of all halls together; the next robots appear when all gateways have these
  connections closed      by routers whose neighbour took nothing for 20 s (wait_before_close)
  declares, knows         declarations of the gateway, and all, in its router's admin space (bench/router_tables.py)
  for each of the fleet   divided by all robots of the fleet, not only those behind this router
  link ... cut            the link between core and area goes down (ip link set down) without closing connections
  area lost               routers, robots, gateway and a master of the Redis Cluster are killed together
"""

import argparse
import contextlib
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from bench.crowd import Size
from bench.machine import machine
from bench.namespaces import full_name, namespaces
from bench.robots import Figures, spread, table
from bench.router_faults import RATE_HZ, faults, online, rotated, seen, taken
from bench.router_tables import KINDS
from bench.router_tree import AREAS, BATCH, CORE, HALLS, Tree, growing
from bench.scene import process_cpu_s, rss_kib
from bench.table import UnavailableError
from redis_servers import cluster_replicated
from running import ROOT

STAYS = next(iter(AREAS))
SHOWN = (CORE, STAYS, AREAS[STAYS][0])
"""Routers whose figures are shown; others of their levels are like them."""
_COUNTED = 5000
"""The size up to which declarations are counted: a router that lists those of 10,000 robots loses its neighbours."""
_NOT_COUNTED = "not counted"


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m bench.routers", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for name, value in (("robots", 10_000), ("joints", 18), ("models", 20), ("requests", 60), ("namespaces", 10)):
        parser.add_argument(f"--{name}", type=int, default=value)
    parser.add_argument("--seconds", type=float, default=8.0, help="of each measurement")
    parser.add_argument("--minutes", type=float, default=20.0, help="it is stopped after that time")
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
            command = [sys.executable, "tests/support/in_namespace.py", full_name("hub"), "-m", "bench.routers"]
            limit_s = minutes * 60
            return subprocess.run(  # noqa: S603
                [*command, "--inside", *sys.argv[1:]], cwd=ROOT, env=environment, check=False, timeout=limit_s
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
        yield {"seen at the core": faults(tree)}


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
        {name: process_cpu_s(pid) for name, pid in pids.items()},
        {name: rss_kib(pid) for name, pid in pids.items()},
        {at: tree.uplinks[at].carried_bytes()[1] for at in tree.gateways},
        {name: site.north.carried_bytes()[1] for name in SHOWN if (site := tree.sites[name]).north is not None},
    )


def joining(tree: Tree) -> tuple[dict[str, Figures], dict[str, Figures]]:
    """Let all robots join as fast as gateways take them. Return figures of gateways and of routers, by name."""
    robots, before = seen(tree), spent(tree)
    first_ns = tree.appear(HALLS, RATE_HZ, lambda: taken(tree))
    took_s = (time.monotonic_ns() - first_ns) / 1e9
    after = spent(tree)

    def each(what: Callable[[Spent], Mapping[str, float]], name: str, among: int) -> float:
        return (what(after)[name] - what(before)[name]) / among

    counted = tree.size.robots <= _COUNTED
    known = {at: tree.sites[at].known() for at in {*tree.gateways, *SHOWN}} if counted else {}
    gateways = {
        at: {
            f"joining, {BATCH} at a time: until all can be browsed, s": f"{took_s:.1f}",
            "— CPU a robot, ms": f"{each(lambda said: said.cpu_s, at, robots) * 1e3:.2f}",
            "— received a robot, kB": f"{each(lambda said: said.to_gateway, at, robots) / 1e3:.1f}",
            "declares: tokens, queryables, subscribers": (
                _declared(known[at][tree.uplinks[at].address]) if counted else _NOT_COUNTED
            ),
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
            "knows: tokens, queryables, subscribers": _declared(known[site]["all"]) if counted else _NOT_COUNTED,
            "memory with no robot, MiB": f"{before.rss_kib[name] / 1024:.0f}",
            "— more for each of the fleet, kB": f"{each(lambda said: said.rss_kib, name, fleet) * 1.024:.1f}",
            "joining: CPU for each of the fleet, ms": f"{each(lambda said: said.cpu_s, name, fleet) * 1e3:.2f}",
        }
        routers[name]["— connections closed"] = f"{tree.sites[site].closings}"
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
        took, refused = list[float](), 0
        for number in range(tree.size.requests):
            begin = time.perf_counter()
            refused += rotated(tree, at, number * 7919 % seen(tree)) != 204
            took.append((time.perf_counter() - begin) * 1e3)
        found[at] = {
            "command, from POST to acceptance, p50 / p99, ms": spread(took),
            "— refused or not answered": f"{refused} of {tree.size.requests}",
        }
    return found


def _declared(found: Mapping[str, int]) -> str:
    return ", ".join(f"{found.get(kind, 0):,}" for kind in KINDS)


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        sys.exit(main())
