"""Two of agent, gateway and Redis are killed at once: the rest keeps its promises, and everything comes back."""

import contextlib
import itertools
import signal
import time
from collections.abc import Callable, Iterator

import httpx
import pytest
from rdflib import URIRef

from browser import HYBRIT, LF, ROS, Browser
from commanding import PAN, WRIST, angle, begun, ended, moving, of_joint, put, radian, slowly
from gateway_group import complete
from receivers import CallbackReceiver, receiving
from redis_servers import Servers, single
from running import Process, eventually, process
from small_fleet import Place, live
from subscribers import angle_in, graph_of, members

pytestmark = pytest.mark.virtual


class Part:
    """A process that can be killed and restarted with the same arguments."""

    def __init__(self, ready: str, *command: str) -> None:
        self._ready, self._command = ready, command
        self._open = contextlib.ExitStack()
        self.process: Process

    def start(self) -> None:
        self.process = self._open.enter_context(process(*self._command))
        if self._ready:
            self.process.said(self._ready)

    def kill(self) -> None:
        self.process.send(signal.SIGKILL)
        self.process.ended()

    def close(self) -> None:
        self._open.close()


class Fleet:
    """A robot, a gateway and Redis, and optional parts between clients and them; requests go to ``root``."""

    def __init__(self, memory: Servers, root: str, parts: dict[str, Part]) -> None:
        (self._node,) = memory.nodes
        self._parts = parts
        self.browser = Browser(root)

    def start(self, *names: str) -> None:
        for name in names or self._parts:
            self._node.start() if name == "Redis" else self._parts[name].start()

    def kill(self, *names: str) -> None:
        for name in names:
            self._node.kill() if name == "Redis" else self._parts[name].kill()

    def close(self) -> None:
        self.browser.close()
        for part in self._parts.values():
            part.close()


Scene = tuple[Fleet, CallbackReceiver]


@contextlib.contextmanager
def started(fleet: Fleet) -> Iterator[Scene]:
    with receiving() as receiver, contextlib.closing(fleet):
        fleet.start()
        live(fleet.browser, "ur5")
        yield fleet, receiver


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Scene]:
    place = Place(tmp_path_factory.mktemp("state"))
    with single(tmp_path_factory.mktemp("redis")) as memory:
        parts = {
            "gateway": Part("serving", *place.command(), "--redis-url", memory.url),
            "agent": Part("", "-m", "linked_fleet_agent", "--robot=ur5", "--connect", place.zenoh),
        }
        with started(Fleet(memory, place.root, parts)) as scene:
            yield scene


def _subscribe(browser: Browser, url: str) -> str:
    joint = browser.part("ur5", WRIST)
    body = (
        f"@prefix hybrit: <{HYBRIT}> . [] a hybrit:Subscription, hybrit:WebCallback ; "
        f'hybrit:onResource <{joint.one(ROS.rotation)}> ; hybrit:callbackURL "{url}" .'
    )
    answer = browser.http.post(
        str(joint.one(HYBRIT.subscriptions)), content=body, headers={"content-type": "text/turtle"}
    )
    assert answer.status_code == 201, answer.text
    return answer.headers["location"]


_PARTS = ("agent", "gateway", "Redis")


@pytest.mark.parametrize("pair", [*itertools.combinations(_PARTS, 2), _PARTS], ids="+".join)
def test_restarted_pairs_keep_accepted_subscriptions_and_invocations(fleet: Scene, pair: tuple[str, ...]) -> None:
    come_back(fleet, pair)


def come_back(fleet: Scene, pair: tuple[str, ...]) -> None:
    """Check that the motion is truly reported as over or unknown, the callback is delivered, and the robot moves."""
    whole, receiver = fleet
    browser, path = whole.browser, f"/{'-'.join(pair)}"
    eventually(lambda: _answers(lambda: live(browser, "ur5")), "the fleet")
    kept = eventually(lambda: _answers(lambda: _subscribe(browser, receiver.url(path))), "a subscription")
    present = angle(browser, PAN)
    motion = begun(put(browser, of_joint(browser, PAN), slowly(present + (-2.0 if present > 0 else 2.0))))
    moving(browser, PAN)
    whole.kill(*pair)
    time.sleep(1.0)  # longer than an agent waits for a connection to come back
    whole.start(*(name for name in ("Redis", "router", "gateway", "agent", "front") if name in pair))
    eventually(lambda: _answers(lambda: live(browser, "ur5")), "the fleet")
    if {"agent", "gateway"} & {*pair}:  # the robot has lost its motion, or has been restarted
        assert ended(browser, motion).one(LF.state) == LF.failed
    elif "router" in pair:  # a router that is back within the agent's grace period costs no motion
        assert ended(browser, motion).one(LF.state) in (LF.failed, LF.succeeded)
    target = 0.3 if abs(angle(browser, WRIST)) < 0.1 else 0.0
    again = eventually(lambda: _moved(browser, target), "a motion that is accepted")
    assert ended(browser, again).one(LF.state) == LF.succeeded
    eventually(lambda: _last(receiver, path) == pytest.approx(target, abs=0.01), "the place in a delivery")
    container = str(browser.part("ur5", WRIST).one(HYBRIT.subscriptions))
    assert kept in members(browser.page(container))
    assert browser.http.delete(kept).status_code == 204


def _answers(ask: Callable[[], object]) -> object:
    """Return the response; None while nobody can respond."""
    try:
        return ask()
    except (httpx.TransportError, AssertionError):
        return None


def _moved(browser: Browser, target: float) -> str:
    answer = put(browser, of_joint(browser, WRIST), radian(target))
    assert answer.status_code in (204, 503, 504, 409), answer.text
    return answer.headers["location"] if answer.status_code == 204 else ""


def _last(receiver: CallbackReceiver, path: str) -> float | None:
    log = complete(receiver.log(path, "POST"))
    if not log:
        return None
    resource = log[-1].headers["link"].partition(">")[0].removeprefix("<")
    return angle_in(graph_of(log[-1].body, "text/turtle", resource), URIRef(resource))
