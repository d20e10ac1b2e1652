"""A gateway without an extension works: every link resolves, and nothing of the extension is served."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from browser import Browser
from fake_robots import FakeRobot, open_session
from linked_fleet_client.conform.verdict import Outcome
from linked_fleet_gateway.app.extensions import BUILT_IN
from running import eventually, process
from small_fleet import Place
from tests.client.test_conform_server import check, outcomes
from walk import Walk, walk

pytestmark = pytest.mark.virtual

NAMES = [each.name for each in BUILT_IN]
PATHS = {
    "world": "world", "rules": "rules", "query": "query", "things": ".well-known/wot", "history": "odd/history",
    "audit": "audit", "sessions": "login",
}  # fmt: skip
"""A path of each extension that has one independent of robots."""


def needing(name: str) -> list[str]:
    """Return the extension and those that depend on it."""
    found = [name]
    for each in [each for each in BUILT_IN if name in each.needs]:
        found += needing(each.name)
    return found


@contextlib.contextmanager
def gateway(folder: Path, off: list[str]) -> Iterator[tuple[httpx.Client, str]]:
    place = Place(folder)
    with process(*place.command(), "--extensions-off", ",".join(off)) as one, open_session(place.zenoh) as session:
        one.said("serving")
        actor = FakeRobot(session, "odd").appear()
        actor.put("state", actor.frame((0.5,)))
        with contextlib.closing(Browser(place.root)) as browser:
            eventually(lambda: browser.http.get(f"{place.root}odd/").status_code == 200, "the robot")
            yield browser.http, place.root


def tree(http: httpx.Client, root: str) -> Walk:
    return walk(root, http)


@pytest.mark.parametrize("name", NAMES)
def test_a_gateway_works_without_each_extension(tmp_path: Path, name: str) -> None:
    off = needing(name)
    with gateway(tmp_path, off) as (http, root):
        found = tree(http, root)
        assert f"{root}odd/elbow/rotation" in found.pages
        for other, path in PATHS.items():
            here = http.get(root + path, headers={"accept": "*/*"})
            assert (here.status_code == 404) == (other in off or other == "sessions"), path
        html = http.get(root, headers={"accept": "text/html"}).status_code
        assert html == (406 if name == "pages" else 200)


def test_the_core_alone_conforms(tmp_path: Path) -> None:
    """R0.x and R1.x hold with every extension disabled."""
    with gateway(tmp_path, NAMES) as (http, root):
        found = tree(http, root)
        assert not [url for url in found.pages if any(url.startswith(root + path) for path in PATHS.values())]
        report = check(root, no_write=False)
        assert outcomes(report, Outcome.FAILED) == {"R0.7"}  # 201 to a POST that creates a member, as LDP requires
        assert len(outcomes(report, Outcome.PASSED)) > 20
        assert not report.violates_must
