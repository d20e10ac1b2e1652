"""A gateway with two arms, to which queries are sent."""

import contextlib
from collections.abc import Iterator

import httpx
import pytest

from browser import Browser
from running import process
from small_fleet import Place, live


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    place = Place(tmp_path_factory.mktemp("state"))
    with (
        place.gateway() as (_, browser),
        process("-m", "linked_fleet_agent", "--robot=ur5", "--robot=panda", "--connect", place.zenoh),
    ):
        live(browser, "ur5"), live(browser, "panda")
        yield place.root


@pytest.fixture(scope="module")
def http(root: str) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=root, timeout=30) as http:
        yield http


@pytest.fixture(scope="module")
def browser(root: str) -> Iterator[Browser]:
    with contextlib.closing(Browser(root)) as browser:
        yield browser
