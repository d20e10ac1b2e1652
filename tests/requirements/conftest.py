"""One walk of the tree, shared by all requirements of a file."""

import httpx
import pytest

from browser import Browser
from walk import Walk, walk


@pytest.fixture(scope="module")
def tree(browser: Browser) -> Walk:
    return walk(browser.root, browser.http)


@pytest.fixture(scope="module")
def http(browser: Browser) -> httpx.Client:
    return browser.http
