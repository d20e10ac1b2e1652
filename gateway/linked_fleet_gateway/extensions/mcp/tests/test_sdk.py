"""The SDK, loaded at the first message."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from types import SimpleNamespace
from typing import Any

import pytest

from linked_fleet_gateway.extensions.mcp import extension
from linked_fleet_gateway.extensions.mcp.extension import Sdk


class Manager:
    handle_request = "the application"

    @asynccontextmanager
    async def run(self) -> AsyncIterator[None]:
        yield


async def test_an_error_while_the_sdk_is_loaded_does_not_end_it_for_good(monkeypatch: pytest.MonkeyPatch) -> None:
    """For example too many open files."""
    core: Any = SimpleNamespace(section=lambda kind: None)
    failures = [OSError("Too many open files")]

    def loaded(name: str) -> Any:
        if failures:
            raise failures.pop()
        return SimpleNamespace(new_manager=lambda version, settings: Manager())

    monkeypatch.setattr(extension, "import_module", loaded)
    sdk = Sdk(core)
    with pytest.raises(OSError, match="Too many"):
        await sdk.app()
    assert await sdk.app() == await sdk.app() == Manager.handle_request  # type: ignore[comparison-overlap]
    await sdk.end()
