"""CORS for pages of other sites that may use the fleet (WHATWG Fetch, "HTTP-CORS protocol")."""

from collections.abc import Iterable

from starlette.middleware import Middleware
from starlette.middleware.cors import CORSMiddleware

_METHODS = ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS")
_ASKED = (
    "authorization", "content-type", "if-match", "if-none-match", "idempotency-key", "last-event-id", "lock-token",
    "prefer", "traceparent", "x-request-id",
)  # fmt: skip
_ANSWERED = (
    "accept-patch", "accept-post", "accept-put", "allow", "etag", "link", "location", "lock-token",
    "preference-applied", "retry-after", "www-authenticate", "x-request-id",
)  # fmt: skip


def cors_middleware(
    origins: tuple[str, ...], asked: Iterable[str] = (), answered: Iterable[str] = ()
) -> list[Middleware]:
    """Return the middleware; none without ``origins``. Cookies are excluded, because these pages use tokens.

    ``asked`` and ``answered`` are further fields that pages may send and read.
    """
    if not origins:
        return []
    return [
        Middleware(
            CORSMiddleware,
            allow_origins=origins, allow_methods=_METHODS, allow_headers=(*_ASKED, *asked),
            expose_headers=(*_ANSWERED, *answered),
            allow_credentials=False,
        )
    ]  # fmt: skip
