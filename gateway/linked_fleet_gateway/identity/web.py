"""HTTP client for issuers of tokens: JSON documents, bounded in size and time."""

import asyncio
import json
import ssl
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from linked_fleet_gateway.base.lazy_imports import LazyModule

if TYPE_CHECKING:
    import httpx
else:
    httpx = LazyModule("httpx")


_TIMEOUT_S = 5.0  # for a complete exchange
_MOST_BYTES = 1024 * 1024


class IssuerSilent(Exception):  # noqa: N818 -- a state of the issuer, not a defect
    """No usable answer; the text says why."""


class Web:
    """Requests to issuers. Redirects are not followed, and only JSON objects are accepted."""

    def __init__(self) -> None:
        # Proxies of the environment are ignored, because answers must come from the issuer itself.
        self._client = httpx.AsyncClient(verify=ssl.create_default_context(), trust_env=False, timeout=_TIMEOUT_S)

    async def aclose(self) -> None:
        await self._client.aclose()

    async def get(self, url: str) -> dict[str, Any]:
        """Return a JSON document. Raises IssuerSilent."""
        return await self._ask("GET", url)

    async def post(self, url: str, form: Mapping[str, str], secret: tuple[str, str] | None) -> dict[str, Any]:
        """Post a form; ``secret`` is the client id and password, if any. Raises IssuerSilent."""
        return await self._ask("POST", url, data=dict(form), auth=secret)

    async def _ask(self, method: str, url: str, **said: Any) -> dict[str, Any]:
        try:
            async with (
                asyncio.timeout(_TIMEOUT_S),
                self._client.stream(method, url, headers={"accept": "application/json"}, **said) as response,
            ):
                body = b""
                async for piece in response.aiter_bytes():
                    body += piece
                    if len(body) > _MOST_BYTES:
                        raise IssuerSilent(f"{url} answered with more than {_MOST_BYTES} bytes")
        except (httpx.HTTPError, httpx.InvalidURL, TimeoutError, OSError) as error:
            raise IssuerSilent(f"{url}: {type(error).__name__} {error}") from error
        if response.status_code != 200:
            raise IssuerSilent(f"{url} answered with status {response.status_code}")
        try:
            found = json.loads(body)
        except ValueError as error:
            raise IssuerSilent(f"{url} answered with what is no JSON") from error
        if not isinstance(found, dict):
            raise IssuerSilent(f"{url} answered with what is no object of JSON")
        return found
