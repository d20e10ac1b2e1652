"""A hook that keeps garbage collection out of pytest's description of a failure.

pytest parses the source of a failed test. The collection of a task that failed logs a traceback, for which Python 3.11
parses source too. Its parser is not reentrant: pytest ends with "AST constructor recursion depth mismatch", and neither
the failure nor the tests after it are reported.
"""

import gc
from collections.abc import Generator

import pytest


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    enabled = gc.isenabled()
    gc.disable()
    try:
        return (yield)
    finally:
        if enabled:
            gc.enable()
