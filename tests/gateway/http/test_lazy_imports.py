"""Modules first needed by a request are loaded before it continues, once, without delaying others."""

import asyncio
import threading
from types import SimpleNamespace
from typing import cast

from linked_fleet_gateway.extensions.pages.extension import Pages
from linked_fleet_gateway.http.entrance import SUBSCRIPTION_MODULES, ModuleLoader
from linked_fleet_gateway.http.representation import Representations
from linked_fleet_gateway.http.request import Application, Gateway, Services


def asked(*requests: tuple[str, str, str]) -> list[str]:
    """Return the ordered events for these requests: method, path, Accept."""
    happened: list[str] = []

    def load(name: str) -> None:
        assert threading.current_thread() is not threading.main_thread()
        happened.append(name)

    gateway = Gateway(cast(Application, None))
    gateway.services = cast(Services, SimpleNamespace(representations=Representations(Pages())))

    async def run() -> None:
        loading = ModuleLoader(load)
        for method, path, accept in requests:
            headers = [(b"accept", accept.encode())]
            scope = {"type": "http", "method": method, "path": path, "headers": headers, "app": gateway}
            await loading.load(scope)
            happened.append(path)

    asyncio.run(run())
    return happened


def test_a_page_waits_for_the_modules_of_pages() -> None:
    page = ("GET", "/a", "text/html,*/*;q=0.8")
    assert asked(("GET", "/t", "text/turtle"), page, page) == ["/t", *Pages.modules, "/a", "/a"]


def test_a_subscription_waits_for_its_modules() -> None:
    there = ("POST", "/r/subscriptions", "*/*")
    assert asked(("POST", "/r/actions/stop", "text/html"), there) == [
        "/r/actions/stop",
        *SUBSCRIPTION_MODULES,
        there[1],
    ]
