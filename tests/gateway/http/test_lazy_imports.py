"""What a request is the first to need is there before the request goes on, once, and for nobody else."""

import asyncio
import threading

from starlette.types import Receive, Scope, Send

from gateway.http.lazy_imports import PAGES, SUBSCRIPTIONS, Loading


def asked(*requests: tuple[str, str, str]) -> list[str]:
    """What happened, in order, when these came: method, path, Accept."""
    happened: list[str] = []

    def load(name: str) -> None:
        assert threading.current_thread() is not threading.main_thread()
        happened.append(name)

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        happened.append(scope["path"])

    async def run() -> None:
        loading = Loading(app, load)
        for method, path, accept in requests:
            scope = {"type": "http", "method": method, "path": path, "headers": [(b"accept", accept.encode())]}
            await loading(scope, None, None)  # type: ignore[arg-type]

    asyncio.run(run())
    return happened


def test_a_page_waits_for_what_pages_are_made_with() -> None:
    page = ("GET", "/a", "text/html,*/*;q=0.8")
    assert asked(("GET", "/t", "text/turtle"), page, page) == ["/t", *PAGES, "/a", "/a"]


def test_a_subscription_waits_for_what_judges_it() -> None:
    there = ("POST", "/r/subscriptions", "*/*")
    assert asked(("POST", "/r/actions/stop", "text/html"), there) == ["/r/actions/stop", *SUBSCRIPTIONS, there[1]]
