"""One walk of the whole tree serves all requirements."""

import httpx
import pytest
from browser import Browser
from walk import Walk, walk


@pytest.fixture(scope="session")
def tree(browser: Browser) -> Walk:
    return walk(browser.root, browser.http)


@pytest.fixture(scope="session")
def http(browser: Browser) -> httpx.Client:
    return browser.http
