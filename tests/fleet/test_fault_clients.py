"""A client that sends too many requests to a gateway with low limits: robots can still be stopped."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from browser import LF, Browser
from commanding import PAN, begun, moving, of_joint, of_robot, post, problem, put, slowly
from running import Process, eventually, process
from small_fleet import Place, live

pytestmark = pytest.mark.virtual


@contextlib.contextmanager
def narrow(folder: Path, *flags: str) -> Iterator[tuple[Place, Process, Browser]]:
    place = Place(folder)
    with process(*place.command(), *flags) as gateway, contextlib.closing(Browser(place.root)) as browser:
        gateway.said("serving")
        yield place, gateway, browser
        assert "Traceback" not in gateway.output


def _served(answer: httpx.Response) -> httpx.Response | None:
    """Return the response, or None if it was refused by the rate limit or because a motion is not over yet."""
    return answer if answer.status_code == 200 and "lf:running" not in answer.text else None


def test_a_client_above_its_rate_is_refused_and_can_still_stop_robots(tmp_path: Path) -> None:
    with narrow(tmp_path, "--requests-per-client", "40") as (place, _, browser), place.ur5():
        live(browser, "ur5")
        stop = of_robot(browser, LF.StopRobot)
        motion = begun(put(browser, of_joint(browser, PAN), slowly(2.0)))
        moving(browser, PAN)
        for _ in range(3000):
            answer = browser.http.get(browser.root)
            if answer.status_code == 429:
                break
        assert problem(answer) == (429, "too-many-requests")
        assert int(answer.headers["retry-after"]) > 0
        for path in ("health/live", "metrics"):
            assert browser.http.get(browser.root + path).status_code == 200
        begun(post(browser, stop))
        answer = eventually(lambda: _served(browser.http.get(motion)), "the end of the motion")
        assert "lf:state lf:cancelled" in answer.text


_LOOKS_LIKE_A_STOP = (
    "nowhere/actions/stop",
    "nowhere/stop",
    "ur5/nothing/actions/hold",
    "ur5/stop",
    "stopAll",
    "ur5/actions/rotate/invocations/none/actions/cancel",
    "ur5/actions/stop/invocations/none/cancel/",
)


@pytest.mark.parametrize("accept", ["text/turtle", "text/html"])
@pytest.mark.parametrize("path", _LOOKS_LIKE_A_STOP)
def test_what_only_looks_like_a_stop_is_counted(path: str, accept: str, tmp_path: Path) -> None:
    """The same refusal whatever the client accepts."""
    with narrow(tmp_path, "--requests-per-client", "2") as (place, _, browser), place.ur5():
        live(browser, "ur5")
        for _ in range(100):
            answer = browser.http.post(browser.root + path, headers={"accept": accept})
            if answer.status_code == 429:
                break
            assert answer.status_code in (404, 405), answer.text
        assert problem(answer) == (429, "too-many-requests")
        assert browser.http.get(browser.root, headers={"accept": accept}).content == answer.content
        for stop in ("ur5/actions/stop", "actions/stopAll/"):
            begun(post(browser, browser.root + stop))
