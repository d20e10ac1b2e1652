"""Needs of tests besides the Python environment: tests without them fail, or ``make test-extension`` omits them."""

import os
from typing import NoReturn

import pytest

VARIABLE = "ENVIRONMENT_ALONE"
"""Set by ``make test-extension``, which installs no program."""


def missing(what: str, command: str) -> NoReturn:
    """End the test that needs ``what``: skip it if only the environment is there, else fail, naming the ``command``."""
    if VARIABLE in os.environ:
        pytest.skip(f"left out: needs {what}; make test runs it")
    pytest.fail(f"{what} is missing: {command}", pytrace=False)
