"""Time of action requests other than accepted motions: rehearsals, refusals, and stops of five simulated robots."""

import contextlib
import multiprocessing
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import httpx

from bench.scene import browsing, scene
from bench.table import Row, known, percentile
from browser import HYBRIT, LF, Browser
from running import eventually, process
from shared_fixtures import ROBOTS
from small_fleet import live

_PREFIXES = """@prefix maths: <http://vocab.arvida.de/2015/06/maths/vocab#> .
@prefix unit: <http://qudt.org/vocab/unit/> .
@prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> .
@prefix lf: <https://w3id.org/linked-fleet#> .
"""
_TURTLE = {"content-type": "text/turtle"}
_CLIENTS = 8


def rows(seconds: float) -> list[Row]:
    with (
        scene("--requests-per-client", "0") as place,
        process("-m", "linked_fleet_agent", *(f"--robot={name}" for name in ROBOTS), "--connect", place.place.zenoh),
        browsing(place.place) as browser,
    ):
        for name in ROBOTS:
            live(browser, name)
        found = [_measure(name, send, status, seconds / 2) for name, send, status in _requests(browser)]
        stop_all = browser.action(browser.page(browser.root), LF.StopAll)
        with _busy(browser):
            name = f"stopAll, while {_CLIENTS} clients ask as fast as they can"
            found.append(_measure(name, lambda _: browser.http.post(stop_all), 204, seconds / 2))
    return found


def _requests(browser: Browser) -> list[tuple[str, Callable[[int], httpx.Response], int]]:
    joint = browser.part("ur5", "wrist_3_joint")
    robot = browser.robot("ur5")
    rotate = next(str(a) for a in joint.graph.objects(joint.iri, HYBRIT.action) if str(a).endswith("/rotate"))
    actions = {str(a).rpartition("/")[2]: str(a) for a in robot.graph.objects(robot.iri, HYBRIT.action)}
    links = {str(each).rpartition("/")[2]: str(each) for each in robot.graph.subjects(None, None)}
    link = links["ee_link"]
    stop_all = browser.action(browser.page(browser.root), LF.StopAll)

    def post(url: str, body: str, **headers: str) -> httpx.Response:
        return browser.http.post(url, content=_PREFIXES + body, headers=_TURTLE | headers)

    def scalar(value: float) -> str:
        return f"<> vom:numericalValue {value} ; vom:unit maths:Degree ."

    def pose(x: float) -> str:
        return (
            f"<> lf:ofLink <{link}> ; lf:position [ maths:x {x} ; maths:y 200 ; maths:z 400 ; vom:unit unit:MilliM ] ."
        )

    return [
        ("rotate, rehearsed by the agent", lambda n: post(rotate, scalar(n % 7), prefer="dry-run"), 200),
        ("rotate, refused by the shape", lambda n: post(rotate, scalar(1000)), 422),
        ("reach, rehearsed", lambda n: post(actions["reach"], pose(400 + n % 50), prefer="dry-run"), 200),
        ("reach, out of reach", lambda n: post(actions["reach"], pose(4000)), 422),
        ("stop, accepted by the agent", lambda n: browser.http.post(actions["stop"]), 204),
        ("stopAll, answered by five robots", lambda n: browser.http.post(stop_all), 204),
    ]


@contextlib.contextmanager
def _busy(browser: Browser) -> Iterator[None]:
    """Run clients in a process of their own that read joint states and send the slowest requests."""
    robot = browser.robot("ur5")
    link = next(str(each) for each in robot.graph.subjects() if str(each).endswith("/ee_link"))
    far = f"<> lf:ofLink <{link}> ; lf:position [ maths:x 4000 ; maths:y 0 ; maths:z 0 ; vom:unit unit:MilliM ] ."
    asked = (str(robot.one(LF.jointState)), browser.action(robot, LF.Reach), _PREFIXES + far)
    clients = multiprocessing.get_context("spawn").Process(target=_ask_for_ever, args=asked, daemon=True)
    clients.start()
    try:
        yield
    finally:
        clients.kill()
        clients.join()


def _ask_for_ever(state: str, reach: str, body: str) -> None:
    def ask(number: int) -> None:
        with httpx.Client(timeout=60) as http:
            while True:
                if number == 0:
                    http.post(reach, content=body, headers=_TURTLE)
                else:
                    http.get(state)

    with ThreadPoolExecutor(_CLIENTS) as clients:
        list(clients.map(ask, range(_CLIENTS)))


def _measure(name: str, send: Callable[[int], httpx.Response], status: int, seconds: float) -> Row:
    # A gateway's first search loads its modules; on a busy machine the robot then refuses because the motion is too
    # late.
    eventually(lambda: send(0).status_code == status, name)
    took, end = list[float](), time.monotonic() + seconds
    while time.monotonic() < end:
        begin = time.perf_counter()
        answer = send(len(took))
        took.append((time.perf_counter() - begin) * 1000)
        assert answer.status_code == status, answer.text
    return known(f"{name}, p50", "ms", percentile(took, 0.5))
