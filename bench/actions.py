"""Time of action requests: accepted and refused motions, rehearsals, and stops of one and of five simulated robots.

Requests vary as those of different clients do (``bench/varied.py``). What they are compared with is measured in the
same run: a query on Zenoh, a POST to a bare server, and a write of the same Redis.
"""

import contextlib
import multiprocessing
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from random import Random
from urllib.parse import urlsplit

from bench.beside import BARE, bare, stored_ms, wire
from bench.scene import Scene, cpu_s, scene_of_robots
from bench.table import Row, bounded, known, percentile, within
from bench.varied import Client, Target, for_ever, timed_ms
from browser import LF, Browser
from commanding import PREFIXES
from fuzzing.hostile import Attack, Endpoint, attacks
from linked_fleet_gateway.http.invoke import MAX_BODY_BYTES, MAX_TRIPLES
from running import eventually, free_port
from shared_fixtures import ROBOTS

_JOINTS = (
    *(f"shoulder_{each}_joint" for each in ("pan", "lift")),
    "elbow_joint",
    *(f"wrist_{n}_joint" for n in (1, 2, 3)),
)
_CLIENTS = 8
_QUERY = "a Zenoh query between processes"
_SLOWEST_STOP_MS = 60.0
_QUIET_S = 0.3  # until what earlier requests have left behind is done


def rows(seconds: float) -> list[Row]:
    query_ms = percentile(wire(f"tcp/127.0.0.1:{free_port()}", 100, seconds).answers_ms, 0.5)
    with bare(1) as (url, _):
        posted_ms = percentile(timed_ms(url, [Target("/", lambda chance: _scalar(chance.random()))], 204, seconds), 0.5)
    with scene_of_robots("--requests-per-client", "0") as (place, browser):
        disk_ms = percentile(stored_ms(place.place.state, seconds / 2), 0.5)
        found = [
            known(f"{_QUERY}, p50", "ms", query_ms),
            known(f"a POST to {BARE}, p50", "ms", posted_ms),
            known("a write of Redis to its disk, p50", "ms", disk_ms),
            *_motions(place, browser, seconds, query_ms + posted_ms + disk_ms),
            *_operations(place, seconds),
            *_rehearsals(place, browser, seconds / 2),
            *_stops(place, browser, seconds, query_ms),
        ]
    return found


# -- motions --------------------------------------------------------------------------------------------------------


def _motions(place: Scene, browser: Browser, seconds: float, least_ms: float) -> list[Row]:
    rotations = _rotations(browser)
    name, beside = "from a POST to the agent's acceptance", f"a Zenoh query, a POST to {BARE}, a write of Redis"
    good = [Target(path, lambda chance: _scalar(chance.uniform(-3, 3))) for path in rotations]
    took, cpu_ms = _measure(place, good, 204, seconds)
    bad = [Target(path, lambda chance: _scalar(chance.uniform(1000, 2000))) for path in rotations]
    refused, refused_cpu_ms = _measure(place, bad, 422, seconds)
    return [
        within(f"{name}, p50", percentile(took, 0.5), beside, least_ms, 3),
        known(f"{name}, p10", "ms", percentile(took, 0.1)),
        known(f"{name}, p99", "ms", percentile(took, 0.99)),
        bounded("a POST to the agent's acceptance: processor of the gateway", "ms CPU", cpu_ms, 1.2),
        bounded("rotate, refused by the shape, p50", "ms", percentile(refused, 0.5), 0.8),
        bounded("rotate, refused by the shape: processor of the gateway", "ms CPU", refused_cpu_ms, 0.4),
    ]


def _operations(place: Scene, seconds: float) -> list[Row]:
    """Return the rows of actions of components: an output that is set."""

    def level(chance: Random) -> str:
        return f"{PREFIXES} <> lf:value {chance.choice(('true', 'false'))} ."

    took, cpu_ms = _measure(place, [Target("/ur5/tool/actions/output", level)], 204, seconds)
    name = "from a POST that sets an output to the agent's acceptance"
    return [
        known(f"{name}, p50", "ms", percentile(took, 0.5)),
        bounded(f"{name}: processor of the gateway", "ms CPU", cpu_ms, 1.2),
    ]


def _rehearsals(place: Scene, browser: Browser, seconds: float) -> list[Row]:
    robot = browser.robot("ur5")
    link = next(str(each) for each in robot.graph.subjects(None, None) if str(each).endswith("/ee_link"))
    reach, position = urlsplit(browser.action(robot, LF.Reach)).path, "maths:y 200 ; maths:z 400 ; vom:unit unit:MilliM"

    def pose(x: float) -> str:
        return PREFIXES + f"<> lf:ofLink <{link}> ; lf:position [ maths:x {x} ; {position} ] ."

    cases: list[tuple[str, Sequence[Target], int]] = [
        ("rotate, rehearsed by the agent", [Target(path, lambda _: _scalar(1)) for path in _rotations(browser)], 200),
        ("reach, rehearsed", [Target(reach, lambda chance: pose(chance.uniform(400, 450)))], 200),
        ("reach, out of reach", [Target(reach, lambda chance: pose(chance.uniform(4000, 5000)))], 422),
    ]
    return [
        known(f"{name}, p50", "ms", percentile(_measure(place, targets, status, seconds, "dry-run")[0], 0.5))
        for name, targets, status in cases
    ]


def _rotations(browser: Browser) -> list[str]:
    """Return the paths of ``rotate`` of all joints of one robot."""
    return [urlsplit(browser.action(browser.part("ur5", joint), LF.Rotate)).path for joint in _JOINTS]


# -- stops ----------------------------------------------------------------------------------------------------------


def _stops(place: Scene, browser: Browser, seconds: float, query_ms: float) -> list[Row]:
    one = [Target(urlsplit(browser.action(browser.robot(name), LF.StopRobot)).path, _nothing) for name in ROBOTS]
    every = [Target(urlsplit(browser.action(browser.page(browser.root), LF.StopAll)).path, _nothing)]
    found, busy = list[Row](), f"while {_CLIENTS} clients read as fast as they can and one sends the worst bodies"
    for name, targets in (("stop, accepted by the agent", one), ("stopAll, answered by five robots", every)):
        took, _ = _measure(place, targets, 204, seconds)
        found.append(within(f"{name}, p50", percentile(took, 0.5), _QUERY, query_ms, 2, 1))
    with _busy(browser):
        for name, targets in (("stop", one), ("stopAll", every)):
            took, _ = _measure(place, targets, 204, 3 * seconds)
            found.append(known(f"{name}, {busy}, p50", "ms", percentile(took, 0.5)))
            found.append(bounded(f"{name}, {busy}, p99", "ms", percentile(took, 0.99), _SLOWEST_STOP_MS))
    return found


@contextlib.contextmanager
def _busy(browser: Browser) -> Iterator[None]:
    """Run clients in a process of their own that read random resources, and send the slowest bodies."""
    robot = browser.robot("ur5")
    things = [robot.url, str(robot.one(LF.jointState)), *(browser.part("ur5", joint).url for joint in _JOINTS)]
    paths = [urlsplit(each).path for each in things]
    follow = Endpoint("POST", urlsplit(browser.action(robot, LF.FollowTrajectory)).path, MAX_BODY_BYTES, MAX_TRIPLES)
    clients = multiprocessing.get_context("spawn").Process(
        target=_ask_for_ever, args=(browser.root, paths, attacks(follow)), daemon=True
    )
    clients.start()
    try:
        yield
    finally:
        clients.kill()
        clients.join()


def _ask_for_ever(url: str, paths: Sequence[str], bodies: Sequence[Attack]) -> None:
    def read(seed: int) -> None:
        for _ in for_ever(url, paths, seed):
            pass

    def attack() -> None:
        chance = Random(0)  # noqa: S311
        while True:
            body = chance.choice(bodies)
            with contextlib.closing(Client(url)) as client:
                client.ask("POST", body.endpoint.path, body.body, body.media_type)

    with ThreadPoolExecutor(_CLIENTS + 1) as clients:
        done = [clients.submit(attack), *(clients.submit(read, seed) for seed in range(_CLIENTS))]
        for each in done:
            each.result()


# -- pieces ---------------------------------------------------------------------------------------------------------


def _measure(
    place: Scene, targets: Sequence[Target], status: int, seconds: float, prefer: str = ""
) -> tuple[list[float], float]:
    """Return the times of requests in ms, and the processor time of the gateway for one in ms.

    The gateway's processor time for frames of its robots is measured before, and subtracted.
    """
    # A gateway's first search loads its modules; on a busy machine the robot then refuses because the motion is too
    # late.
    with contextlib.closing(Client(place.place.root, prefer=prefer)) as client:
        eventually(lambda: client.post(targets)[0] == status, f"a response {status}")
    time.sleep(_QUIET_S)
    idle_s = _spent_s(place, lambda: time.sleep(seconds))
    took = list[float]()
    spent_s = _spent_s(place, lambda: took.extend(timed_ms(place.place.root, targets, status, seconds, prefer)))
    return took, (spent_s - idle_s) * 1e3 / len(took)


def _spent_s(place: Scene, act: Callable[[], None]) -> float:
    before_s = cpu_s(place.pid)
    act()
    return cpu_s(place.pid) - before_s


def _scalar(value: float) -> str:
    return f"{PREFIXES}<> vom:numericalValue {value:.4f} ; vom:unit maths:Degree ."


def _nothing(_: Random) -> str:
    return ""
