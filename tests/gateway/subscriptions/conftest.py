"""Both kinds of outlets for the tests of the fan-out."""

from collections.abc import Iterator
from typing import Any

import pytest

from fan_out_world import InStep, Outlet, World


@pytest.fixture(params=[Outlet, InStep], ids=["alone", "in step"])
def outlet_kinds(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Run each test with both kinds of outlets, which must get the same messages alone and in a broadcast.

    No turn may raise.
    """
    failures = list[dict[str, Any]]()
    monkeypatch.setattr(World, "outlet", request.param)
    monkeypatch.setattr(World, "failures", failures)
    yield
    assert not failures
