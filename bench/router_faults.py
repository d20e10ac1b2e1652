"""Faults of a tree of routers, as the gateway at the core sees them: a link is cut, a region is lost."""

import re
import time
from concurrent.futures import ThreadPoolExecutor

from bench.crowd import Gateway
from bench.namespaces import Link
from bench.robots import Figures
from bench.router_tree import AREAS, CORE, Tree
from bench.synthetic import name_of
from commanding import TURTLE, radian

RATE_HZ = 0.5
"""Frame rate: late frames, too, arrive within the 5 s of silence after which a gateway queries a robot."""
_, LOST = AREAS
_ONLINE = re.compile(r'^linked_fleet_robots\{presence="online"\} ([\d.e+]+)$', re.M)
_TIMEOUT_S = 240.0
_COMMANDED = 30
_BRIEF_S = 1.0


class NotHealedError(Exception):
    """A gateway does not have the robots that it should have; the message says how many it has."""


def faults(tree: Tree) -> dict[str, str]:
    """Measure one fault after the other, until one does not heal.

    The long cut is the last: it brings thousands of robots back at once, after which a large tree may not heal.
    """
    found = dict[str, str]()
    for fault in (brief_cut, lost_region, long_cut):
        try:
            found |= fault(tree)
        except NotHealedError as error:
            found[fault.__name__] = str(error)
            break
    found["connections closed by routers in all that time"] = f"{sum(site.closings for site in tree.sites.values())}"
    return found


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
    offline_ns = until(tree.gateways[CORE], robots // 2)
    own = online(tree.gateways[LOST])
    status = rotated(tree, LOST, robots - 1)
    begun_ns = time.monotonic_ns()
    north.heal()
    back = {at: (until(one, robots) - begun_ns) / 1e9 for at, one in tree.gateways.items()}
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
        offline = pool.submit(until, tree.gateways[CORE], robots // 2)
        accepted = pool.submit(_accepted, tree)
        offline_s, elsewhere = (offline.result() - begin_ns) / 1e9, online(tree.gateways[CORE])
        accepted_ns, refused = accepted.result()
    begun_ns = time.monotonic_ns()
    tree.store.nodes[-1].start()
    for name in (LOST, *halls):
        tree.sites[name].start()
    tree.start(LOST)
    tree.populate(halls)
    tree.appear(halls, RATE_HZ, lambda: taken(tree))
    declared_s = (time.monotonic_ns() - begun_ns) / 1e9
    with ThreadPoolExecutor() as pool:
        back_ns = dict(
            zip(tree.gateways, pool.map(lambda one: until(one, robots), tree.gateways.values()), strict=True)
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
    deadline = time.monotonic() + _TIMEOUT_S
    while waiting:
        for number in sorted(waiting):
            if rotated(tree, CORE, number) == 204:
                waiting.discard(number)
            else:
                refused += 1
        assert time.monotonic() < deadline, f"{len(waiting)} robots take no command"
    return time.monotonic_ns(), refused


# -- what is asked of a gateway ---------------------------------------------------------------------------------------


def seen(tree: Tree) -> int:
    """Return the number of robots that a gateway has: those of the first namespace."""
    return tree.size.robots // tree.size.namespaces


def online(one: Gateway) -> int:
    found = _ONLINE.search(one.get("/metrics", "*/*").text)
    return round(float(found[1])) if found else 0


def rotated(tree: Tree, at: str, number: int) -> int:
    """Command the robot with this number among those of a gateway; return the status of the response."""
    one = tree.gateways[at]
    url = f"http://127.0.0.1:{one.port}/{name_of(number * tree.size.namespaces)}/joint_1/actions/rotate"
    return one.http.post(url, content=radian(0.2), headers=TURTLE).status_code


def taken(tree: Tree) -> None:
    """Wait until all gateways have the robots that have appeared."""
    for one in tree.gateways.values():
        until(one, tree.expected)


def until(one: Gateway, robots: int) -> int:
    """Return when exactly so many robots are online (CLOCK_MONOTONIC, ns); asked twice a second at most."""
    deadline = time.monotonic() + _TIMEOUT_S
    while (found := online(one)) != robots:
        if time.monotonic() > deadline:
            raise NotHealedError(f"after {_TIMEOUT_S:g} s {found} robots are online instead of {robots}")
        time.sleep(0.5)
    return time.monotonic_ns()
