"""Lazy imports: modules that a request needs first are loaded in a thread before the request proceeds."""

import asyncio
from collections.abc import Callable
from importlib import import_module
from typing import Final

from starlette.types import Scope

from linked_fleet_gateway.http.arrival import fields_of
from linked_fleet_gateway.http.html import HtmlWriter
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
            needed, html = _needed(scope)
            if needed and needed not in self._loaded:
                await asyncio.to_thread(self._load_all, needed, html)
                self._loaded.add(needed)

    def _load_all(self, names: tuple[str, ...], html: HtmlWriter | None) -> None:
        for name in names:
            self._load(name)
        if html is not None:
            html.prepare()


def _needed(scope: Scope) -> tuple[tuple[str, ...], HtmlWriter | None]:
    """Return the modules, and the writer that is needed for a page."""
    path, method = scope["path"], scope["method"]
    if method in ("POST", "PATCH"):
        container = path if method == "POST" else path.rpartition("/")[0]
        return (SUBSCRIPTIONS if container.endswith("/subscriptions") else ()), None
    html = html_of(scope)
    page = b"text/html" in fields_of(scope).get(b"accept", b"")
    return (tuple(html.modules), html) if html is not None and page else ((), None)
