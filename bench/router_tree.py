"""Three levels of Zenoh routers, each in a network namespace, with robots below and gateways at two levels.

One core, two areas, two halls in each. A router is the north of those below it (Zenoh's Regions, as in the chart for
Kubernetes). Robots are clients of the routers of halls. Gateways, Redis and who measures are in the namespace ``hub``,
which has a link to the core and one to each area.
"""

import contextlib
import json
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

from bench.crowd import Crowd, Gateway, Size
from bench.namespaces import Link, add, full_name, link
from bench.scene import pid_of
from redis_servers import Servers
from running import ROOT, Process, free_port, process

CORE = "core"
AREAS = {"area-1": ("hall-1", "hall-2"), "area-2": ("hall-3", "hall-4")}
HALLS = tuple(hall for halls in AREAS.values() for hall in halls)
_BELOW = {CORE: tuple(AREAS), **AREAS} | dict.fromkeys(HALLS, ())
LEASE_MS = 10_000
BATCH = 400
"""Robots that join before the gateways are asked if they have them.

Thousands at once make routers of Zenoh 1.10 wait for each other (docs/SCALE.md).
"""
_QUEUE = {
    "size": {"control": 16, "data": 16},
    "congestion_control": {"block": {"wait_before_close": 20_000_000}},
}
"""Room for the declarations of a batch, and 20 s (in µs) for a neighbour on a busy machine to take them."""
_CLOSED = "Closing transport!"
_PORT = 7447


@dataclass
class Site:
    """A router in its namespace, and what is started there. ``north`` is the link to the router above."""

    name: str
    folder: Path
    north: Link | None = None
    router: Process | None = None
    crowd: Crowd | None = None
    first: int = 0
    """Number of the first robot there."""
    appeared: int = 0
    """Count of robots there that have appeared."""
    _open: contextlib.ExitStack = field(default_factory=contextlib.ExitStack)

    def start(self) -> None:
        path = self.folder / f"{self.name}.json5"
        path.write_text(json.dumps(configuration(self.name, self.north)))
        self.router = self._open.enter_context(process(*inside(self.name), "tests/support/zenoh_router.py", str(path)))
        self.router.said("routing")

    def robots(self, size: Size, first: int) -> None:
        """Start the process of robots, which have not appeared yet."""
        self.first = first
        self.crowd = Crowd(f"tcp/127.0.0.1:{_PORT}", size, (first, size.namespaces), inside(self.name))
        self._open.callback(self.crowd.close)

    def kill(self) -> None:
        """Kill everything that runs there."""
        if self.crowd is not None:
            self.crowd.kill()
        if self.router is not None:
            self.router.send(signal.SIGKILL)
        self._open.pop_all()
        self.router, self.crowd, self.appeared = None, None, 0

    def close(self) -> None:
        self._open.close()

    @property
    def pid(self) -> int:
        assert self.router is not None
        return pid_of(self.router)

    @property
    def closings(self) -> int:
        """How often the router has closed a connection whose other end did not take its messages in time."""
        return 0 if self.router is None else self.router.output.count(_CLOSED)

    def known(self) -> dict[str, dict[str, int]]:
        """Return the declarations that the router knows (``bench.router_tables``)."""
        command = [sys.executable, *inside(self.name), "-m", "bench.router_tables", f"tcp/127.0.0.1:{_PORT}"]
        said = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)  # noqa: S603
        found: dict[str, dict[str, int]] = json.loads(said.stdout)
        return found


def inside(site: str) -> tuple[str, str]:
    """Return the arguments of Python that continue in the namespace of the site."""
    return "tests/support/in_namespace.py", full_name(site)


def configuration(site: str, north: Link | None) -> dict[str, object]:
    """Return a router's configuration as in the Helm chart, with the admin space to read its declarations."""
    south: list[object] = [{"filters": [{"modes": ["client", "peer"]}]}]
    south += [{"filters": [{"modes": ["router"], "region_names": [region]}]} for region in _BELOW[site]]
    return {
        "mode": "router",
        "region_name": site,
        "gateway": {"south": south},
        "listen": {"endpoints": [f"tcp/0.0.0.0:{_PORT}"]},
        "connect": {
            "endpoints": [f"tcp/{north.address}:{_PORT}"] if north is not None else [],
            "timeout_ms": -1,
            "exit_on_failure": False,
            "retry": {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 1.5},
        },
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {
            "shared_memory": {"enabled": False},
            "link": {"tx": {"lease": LEASE_MS, "queue": _QUEUE}},
            "unicast": {"max_sessions": 20000},
        },
        "adminspace": {"enabled": True},
    }


@dataclass
class Tree:
    """Everything that runs. ``gateways`` and ``uplinks`` have a key for each router that a gateway is connected to."""

    size: Size
    store: Servers
    sites: dict[str, Site]
    uplinks: dict[str, Link]
    gateways: dict[str, Gateway] = field(default_factory=dict)
    _children: dict[str, Process] = field(default_factory=dict)
    _open: dict[str, contextlib.ExitStack] = field(default_factory=dict)

    def start(self, at: str) -> None:
        """Start the gateway at one router."""
        port, kept = free_port(), contextlib.ExitStack()
        command = ("-m", "linked_fleet_gateway", "--port", str(port), "--redis-url", self.store.url)
        router = f"tcp/{self.uplinks[at].far_address}:{_PORT}"
        child = kept.enter_context(process(*command, "--zenoh-connect", router, "--requests-per-client", "0"))
        child.said("serving")
        self.gateways[at], self._open[at] = Gateway(port, pid_of(child)), kept
        kept.callback(self.gateways[at].http.close)
        self._children[at] = child

    def kill(self, at: str) -> None:
        """Kill a gateway."""
        self._children[at].send(signal.SIGKILL)
        del self.gateways[at]

    def populate(self, halls: Sequence[str]) -> None:
        """Start processes of robots in these halls, an equal share of all robots in each."""
        share = self.size.robots // len(HALLS)
        for hall in halls:
            self.sites[hall].robots(replace(self.size, robots=share), HALLS.index(hall) * share)

    def appear(self, halls: Sequence[str], rate_hz: float, taken: Callable[[], None]) -> int:
        """Let the robots of these halls appear, a batch at a time, and call ``taken`` after each batch.

        Return when the first one did (CLOCK_MONOTONIC, ns).
        """
        count, share = BATCH // len(halls), self.size.robots // len(HALLS)

        def batch(hall: str) -> int:
            site = self.sites[hall]
            assert site.crowd is not None
            first_ns = int(site.crowd.ask(f"appear {count}")["first_ns"])
            site.appeared = min(site.appeared + count, share)
            return first_ns

        for hall in halls:
            crowd = self.sites[hall].crowd
            assert crowd is not None
            crowd.ask(f"rate {rate_hz}")
        first_ns = []
        with ThreadPoolExecutor(len(halls)) as pool:
            while any(self.sites[hall].appeared < share for hall in halls):
                first_ns += pool.map(batch, halls)
                taken()
        return min(first_ns)

    @property
    def expected(self) -> int:
        """How many robots of the gateways' namespace have appeared."""
        sites = (self.sites[hall] for hall in HALLS)
        numbers = (range(each.first, each.first + each.appeared) for each in sites)
        return sum(number % self.size.namespaces == 0 for each in numbers for number in each)

    def close(self) -> None:
        for kept in self._open.values():
            kept.close()
        for site in self.sites.values():
            site.close()


@contextlib.contextmanager
def growing(folder: Path, size: Size, store: Servers) -> Iterator[Tree]:
    """Run linked routers, ready gateways, and robots that have not appeared yet."""
    sites, uplinks = {CORE: Site(CORE, folder)}, dict[str, Link]()
    add(CORE)
    for above, below in _BELOW.items():
        for name in below:
            add(name)
            sites[name] = Site(name, folder, link(len(sites), above, name))
    for number, at in enumerate((CORE, *AREAS)):
        uplinks[at] = link(len(sites) + number, "hub", at)
    tree = Tree(size, store, sites, uplinks)
    try:
        for site in sites.values():
            site.start()
        for at in uplinks:
            tree.start(at)
        tree.populate(HALLS)
        yield tree
    finally:
        tree.close()
