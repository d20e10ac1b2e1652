"""HTTP requests to the receiver of one callback; the only module that imports httpx. The receiver may be hostile.

It works below ``httpx.AsyncClient`` on purpose: this layer keeps no cookies, follows no redirects, reads no proxies
from the environment and logs no URL, whose query may be a secret.
"""

# ruff: noqa: N818  (named for what is the case)

import asyncio
import importlib.metadata
import ssl
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any

from linked_fleet_webhooks.delivery_pace import ConsentThrottle, retry_after_s
from linked_fleet_webhooks.network import (
    Address,
    ForbiddenHost,
    Network,
    UnresolvableHost,
    check_callback_url,
)

if TYPE_CHECKING:
    import httpx
else:

    class _Httpx:
        """The module httpx, imported when it is first used: many gateways have no callbacks."""

        def __getattr__(self, name: str) -> Any:
            value = getattr(import_module("httpx"), name)
            setattr(self, name, value)
            return value

    httpx = _Httpx()

TIMEOUT_S = 10.0
MAX_READ_BYTES = 4096
"""Bytes of a response body that are read and ignored. A body that ends within them leaves the connection usable."""
MAX_ADDRESSES = 4
"""Addresses tried for one request, so that a name with a thousand addresses does not cause a thousand connections."""
_KEEP_ALIVE_S = 4.0
"""Below the 5 s after which common servers close idle connections, so that requests seldom hit a closing one."""
_LONGEST_RATE = 9
_TRY_AGAIN = (408, 425, 429)
"""Client errors that ask for a retry (RFC 9110, 15.5.9; RFC 8470; RFC 6585)."""


class NoConsent(Exception):
    """The receiver has not consented, and none of its addresses is in a network that needs no consent."""


class Verdict(StrEnum):
    """The verdict on an attempt.

    GONE: the receiver wants no more (410). REFUSED: it answered a consent request with no.
    """

    DELIVERED = "delivered"
    RETRY = "retry"
    GONE = "gone"
    REFUSED = "refused"


@dataclass(frozen=True)
class DeliveryOutcome:
    """The outcome of one attempt. ``status``: None without a response; ``reason``: a sentence, empty if delivered."""

    verdict: Verdict
    status: int | None
    retry_after_s: float | None
    reason: str


@dataclass(frozen=True)
class ConsentResponse:
    """The response to a request for consent.

    ``refused``: the receiver responded without consenting; False if it did not respond or asked for a retry.
    ``interval_s``: the minimum time between deliveries that it asked for.
    """

    granted: bool
    interval_s: float
    status: int | None
    reason: str
    refused: bool = False


class Receiver:
    """Sends to one URL. Each request resolves the host anew and connects to an address judged in that look-up.

    Raises ValueError for a URL that ``check_callback_url`` rejects. Share the ``ssl_context``, because creating one
    takes 20 ms, and ``consent_throttle``, or consent requests are limited for this receiver alone.
    """

    def __init__(
        self,
        network: Network,
        url: str,
        *,
        ssl_context: ssl.SSLContext,
        consent_throttle: ConsentThrottle | None = None,
        timeout_s: float = TIMEOUT_S,
        connect_timeout_s: float = 3.0,
    ) -> None:
        self._network = network
        self._consent_throttle = consent_throttle or ConsentThrottle()
        self._url = httpx.URL(check_callback_url(url))
        self._timeout_s = timeout_s
        # the pool identifies connections by address and port, not by the name that TLS verified: one pool per URL
        self._pool = httpx.AsyncHTTPTransport(
            verify=ssl_context,
            trust_env=False,
            limits=httpx.Limits(max_connections=2, max_keepalive_connections=1, keepalive_expiry=_KEEP_ALIVE_S),
        )
        self._extensions = {
            "timeout": httpx.Timeout(timeout_s, connect=connect_timeout_s).as_dict(),
            "sni_hostname": self._host.removesuffix("."),
        }
        self._connected = ""

    async def aclose(self) -> None:
        await self._pool.aclose()

    async def deliver(
        self, body: bytes, content_type: str, headers: Mapping[str, str], *, allowed_only: bool
    ) -> DeliveryOutcome:
        """POST a message; failures are outcomes.

        ``allowed_only``: only addresses in the allowed networks are used. Raises NoConsent if there is no such address.
        """
        fields = {**headers, "Content-Type": content_type}
        try:
            response = await self._request("POST", fields, body, lambda address: address.allowed or not allowed_only)
        except (TimeoutError, httpx.TransportError, ForbiddenHost, UnresolvableHost) as error:
            return DeliveryOutcome(Verdict.RETRY, None, None, self._why(error))
        return _outcome(response)

    async def request_consent(self, origin: str) -> ConsentResponse:
        """Ask whether deliveries from ``origin``, a DNS name, are welcome (CloudEvents HTTP Web Hooks 1.0.2, 4).

        Each later delivery must carry ``WebHook-Request-Origin`` with the same value, which is up to the caller. Waits
        until ``consent_throttle`` permits a request to this destination.
        """
        try:
            asked = (await self._addresses())[:MAX_ADDRESSES]
            async with self._consent_throttle.turn(address.ip for address in asked) as turn:
                fields = {"WebHook-Request-Origin": origin}
                response = await self._request("OPTIONS", fields, b"", lambda address: address in asked)
                consent = _consent(response, origin)
                turn.granted = consent.granted
                return consent
        except NoConsent:
            reason = "The callback's host changed its address while it was waited for."
            return ConsentResponse(granted=False, interval_s=0.0, status=None, reason=reason)
        except (TimeoutError, httpx.TransportError, ForbiddenHost, UnresolvableHost) as error:
            return ConsentResponse(granted=False, interval_s=0.0, status=None, reason=self._why(error))

    async def needs_no_consent(self) -> bool:
        """Return True if all permitted addresses are in allowed networks. Raises ForbiddenHost and UnresolvableHost."""
        return all(address.allowed for address in await self._addresses())

    @property
    def _host(self) -> str:
        return self._url.raw_host.decode("ascii")

    async def _addresses(self) -> list[Address]:
        return await self._network.resolve(self._host, self._url.port or (443 if self._url.scheme == "https" else 80))

    async def _request(
        self, method: str, fields: Mapping[str, str], body: bytes, permitted: Callable[[Address], bool]
    ) -> "httpx.Response":
        """Return the response of a permitted address, with its body closed.

        Raises TimeoutError, httpx.TransportError, ForbiddenHost, UnresolvableHost, and NoConsent if no address is
        permitted.
        """
        response = None
        try:
            async with asyncio.timeout(self._timeout_s):
                addresses = [address for address in await self._addresses() if permitted(address)]
                if not addresses:
                    raise NoConsent("The receiver has not consented to deliveries.")
                response = await self._first_reached(addresses, method, fields, body)
                await _drain(response)
        except (TimeoutError, httpx.TransportError):
            if response is None:
                raise
            # the receiver has judged the message; the rest of its response matters only to the connection
        finally:
            if response is not None:
                await response.aclose()
        return response

    async def _first_reached(
        self, addresses: list[Address], method: str, fields: Mapping[str, str], body: bytes
    ) -> "httpx.Response":
        # the address with the open connection first, regardless of the resolver's order
        inclined = sorted(addresses, key=lambda address: address.ip != self._connected)[:MAX_ADDRESSES]
        for address in inclined[:-1]:
            try:
                return await self._send(address, method, fields, body)
            except (httpx.ConnectError, httpx.ConnectTimeout):
                continue
        return await self._send(inclined[-1], method, fields, body)

    async def _send(self, address: Address, method: str, fields: Mapping[str, str], body: bytes) -> "httpx.Response":
        """Send to exactly this address: with a literal as host, no lower layer resolves a name again."""
        headers = httpx.Headers(dict(fields))
        headers["Host"] = self._url.netloc.decode("ascii")
        headers["User-Agent"] = user_agent()
        where = self._url.copy_with(host=address.ip)
        request = httpx.Request(method, where, headers=headers, content=body, extensions=dict(self._extensions))
        response = await self._pool.handle_async_request(request)
        self._connected = address.ip
        return response

    def _why(self, error: Exception) -> str:
        """Return a sentence without addresses, ports or error texts, which would reveal the internal network."""
        match error:
            case ForbiddenHost() | UnresolvableHost():
                return str(error)
            case httpx.ConnectError() if self._url.scheme == "https":
                return "No connection: nobody listens there, or its certificate is not valid for this host."
            case httpx.ConnectError():
                return "No connection: nobody listens there."
            case TimeoutError() | httpx.TimeoutException():
                return "The receiver did not answer in time."
            case _:
                return "The connection broke before there was a valid answer."


@cache
def user_agent() -> str:
    return f"linked-fleet/{importlib.metadata.version('linked-fleet')}"


async def _drain(response: "httpx.Response") -> None:
    read = 0
    async for chunk in response.aiter_raw():
        read += len(chunk)
        if read > MAX_READ_BYTES:
            return


def _outcome(response: "httpx.Response") -> DeliveryOutcome:
    status = response.status_code
    if response.is_success:
        return DeliveryOutcome(Verdict.DELIVERED, status, None, "")
    if status == httpx.codes.GONE:
        return DeliveryOutcome(Verdict.GONE, status, None, "The receiver is gone for good (410).")
    reason = f"The receiver answered with status {status}"
    reason += ", and redirects are not followed." if response.is_redirect else "."
    return DeliveryOutcome(
        Verdict.RETRY, status, retry_after_s(response.headers.get("Retry-After"), time.time()), reason
    )


def _consent(response: "httpx.Response", origin: str) -> ConsentResponse:
    status = response.status_code
    if not response.is_success:
        later = response.is_server_error or status in _TRY_AGAIN
        reason = f"The receiver answered the request for consent with status {status}."
        return ConsentResponse(False, 0.0, status, reason, refused=not later)
    allowed = response.headers.get("WebHook-Allowed-Origin", "").strip()
    if allowed != "*" and allowed.lower() != origin.lower():
        reason = f"The receiver sent no WebHook-Allowed-Origin of {origin} or *."
        return ConsentResponse(False, 0.0, status, reason, refused=True)
    return ConsentResponse(True, _interval_s(response.headers.get("WebHook-Allowed-Rate", "")), status, "")


def _interval_s(rate: str) -> float:
    """Return the seconds between deliveries for a rate per minute; 0 for no limit and for unspecified values."""
    if not (rate.isascii() and rate.isdigit() and len(rate) <= _LONGEST_RATE) or int(rate) == 0:
        return 0.0
    return 60 / int(rate)
