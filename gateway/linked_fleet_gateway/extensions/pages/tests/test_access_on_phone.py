"""Accessibility of pages on a phone (on a desktop: test_access.py)."""

import pytest

from browser import Browser
from every_page import obstacles, pages_of_each_kind
from page_user import PageUser
from shared_fixtures import RunningFleet

pytestmark = [pytest.mark.processes, pytest.mark.test_all]


@pytest.mark.parametrize("operator", ["phone"], indirect=True)
def test_no_page_shuts_anybody_out(operator: PageUser, fleet: RunningFleet, browser: Browser) -> None:
    assert obstacles(operator, pages_of_each_kind(browser)) == []
