"""CORS: the fields that pages of other origins may send and read are those of the core and of extensions."""

import asyncio

import httpx
from starlette.responses import Response

from linked_fleet_gateway.http.entrance import cors_middleware

_PAGE = "https://twin.example"


def _ask(method: str, **fields: str) -> httpx.Response:
    (middleware,) = cors_middleware((_PAGE,), ["x-asked"], ["x-answered"])
    app = middleware.cls(Response(b"served"), *middleware.args, **middleware.kwargs)

    async def ask() -> httpx.Response:
        async with httpx.AsyncClient(transport=httpx.ASGITransport(app=app), base_url="http://127.0.0.1") as client:
            return await client.request(method, "/", headers={"origin": _PAGE, **fields})

    return asyncio.run(ask())


def test_fields_of_extensions_may_be_sent() -> None:
    def asked(name: str) -> int:
        fields = {"access-control-request-method": "POST", "access-control-request-headers": name}
        return _ask("OPTIONS", **fields).status_code

    assert [asked(name) for name in ("prefer", "x-asked", "x-other")] == [200, 200, 400]


def test_fields_of_extensions_may_be_read() -> None:
    exposed = _ask("GET").headers["access-control-expose-headers"].split(", ")
    assert {"location", "x-answered"} <= {*exposed}


def test_nothing_is_added_without_origins() -> None:
    assert cors_middleware((), ["x-asked"], ["x-answered"]) == []
