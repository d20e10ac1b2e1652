"""Lazy imports: modules that a request needs first are loaded in a thread before the request proceeds."""

import asyncio
from collections.abc import Callable
from importlib import import_module
from typing import Final

from starlette.types import Scope

from linked_fleet_gateway.http.arrival import fields_of
from linked_fleet_gateway.http.request import html_of

SUBSCRIPTIONS: Final = ("httpx",)


class ModuleLoader:
    """Loads modules in a thread: each takes 0.1 s, in which the event loop would serve nobody else."""

    def __init__(self, load: Callable[[str], object] = import_module) -> None:
        self._load = load
        self._loaded: set[tuple[str, ...]] = set()

    async def load(self, scope: Scope) -> None:
        """Return when the modules that a request needs have been imported."""
        if len(self._loaded) < 2 and scope["type"] == "http":
            needed = _needed(scope)
            if needed and needed not in self._loaded:
                await asyncio.to_thread(self._load_all, needed)
                self._loaded.add(needed)

    def _load_all(self, names: tuple[str, ...]) -> None:
        for name in names:
            self._load(name)


def _needed(scope: Scope) -> tuple[str, ...]:
    path, method = scope["path"], scope["method"]
    if method in ("POST", "PATCH"):
        container = path if method == "POST" else path.rpartition("/")[0]
        return SUBSCRIPTIONS if container.endswith("/subscriptions") else ()
    html = html_of(scope)
    page = b"text/html" in fields_of(scope).get(b"accept", b"")
    return tuple(html.modules) if html is not None and page else ()
