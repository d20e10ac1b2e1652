"""RDF in request bodies: complete, bounded, and parsed with the IRI of the target resource as base."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, TypeVar

from pyoxigraph import NamedNode, Triple
from starlette.requests import ClientDisconnect

from linked_fleet_base.errors import BadRequest, PayloadTooLarge, UnsupportedMediaType
from linked_fleet_gateway.http.fields import field
from linked_fleet_gateway.http.negotiation import parse_content_type
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.http.scheduling import LONG_BYTES, Offload
from linked_fleet_gateway.resources.affordance import BODY_TYPES
from linked_fleet_gateway.resources.form import DeclaredForm
from linked_fleet_rdf.json_input import InputTooLargeError
from linked_fleet_rdf.parsing import MAX_TRIPLES, ParseError, parse
from linked_fleet_rdf.serialise import JSON
from linked_fleet_rdf.vocabulary import PREFIXES

if TYPE_CHECKING:
    from linked_fleet_gateway.resources.form import Form

MAX_BODY_BYTES = 64 * 1024
_CONTEXT = "https://w3id.org/linked-fleet/context"
T = TypeVar("T")


def body_type(request: Request, accepted: Sequence[str] = BODY_TYPES) -> str:
    """Return the media type of the body, before it is read. Raises 415 or 400 errors."""
    media_type, _ = parse_content_type(field(request, "content-type"), accepted)
    _check_whole(request)
    return media_type


async def convert_body(
    request: Request, convert: Callable[[bytes], T], max_bytes: int = MAX_BODY_BYTES, *, is_slow: bool = False
) -> T:
    """Apply ``convert`` to the whole body, in a thread unless it is short and ``convert`` is not slow.

    Raises PayloadTooLarge, Busy, errors of ``convert``.
    """
    offload: Offload = request.services.offload
    content = await read_body(request, max_bytes)
    return await offload.run(partial(convert, content), LONG_BYTES if is_slow else len(content))


def parse_body(
    body: bytes,
    media_type: str,
    iri: str,
    base: str,
    max_triples: int = MAX_TRIPLES,
    lengths: Mapping[NamedNode, int] | None = None,
) -> list[Triple]:
    """Return the triples of a body, with relative IRIs resolved against ``iri``.

    Raises BadRequest, PayloadTooLarge.
    """
    context = {"@context": PREFIXES}
    contexts = {_CONTEXT: context, f"{base}/context": context}
    try:
        return parse(body, media_type, iri, contexts=contexts, max_triples=max_triples, lengths=lengths)
    except InputTooLargeError as error:
        raise PayloadTooLarge(f"The body is too much: {error}.") from error
    except ParseError as error:
        raise BadRequest(f"The body is no {media_type}: {error}", line=error.line, column=error.column) from error


def parse_form(
    body: bytes, media_type: str, iri: str, base: str, form: "Callable[[], Form]", max_triples: int = MAX_TRIPLES
) -> list[Triple]:
    """Parse like ``parse_body``, or as plain JSON by ``form``."""
    if media_type != JSON:
        return parse_body(body, media_type, iri, base, max_triples)
    from linked_fleet_gateway.resources.plain_json import parse_json_body

    known = form()
    if isinstance(known, DeclaredForm):
        return known.read(body, iri, max_triples)
    return parse_json_body(body, known, iri, max_triples)


def _check_whole(request: Request) -> None:
    """Refuse a compressed (RFC 9110, 8.4 and 15.5.16) or partial (14.5) body."""
    coding = (field(request, "content-encoding") or "identity").strip().lower()
    if coding != "identity":
        raise UnsupportedMediaType(
            f"Content-Encoding {coding} is not taken; send the body as it is.", headers={"Accept-Encoding": "identity"}
        )
    if b"content-range" in request.arrival.fields:
        raise BadRequest("Content-Range is not taken; send the whole body.")


async def read_body(request: Request, max_bytes: int = MAX_BODY_BYTES) -> bytes:
    """Return the body of at most ``max_bytes`` bytes. Raises PayloadTooLarge as early as possible."""
    length = field(request, "content-length") or ""
    if length.isdecimal() and int(length) > max_bytes:
        raise PayloadTooLarge(f"The body has {length} bytes; at most {max_bytes} are read.")
    body, more = bytearray(), True
    # Not Request.stream(): asyncio registers each asynchronous generator, which costs as much as all else here.
    while more:
        message = await request.receive()
        if message["type"] == "http.disconnect":
            raise ClientDisconnect
        body += message.get("body", b"")
        more = message.get("more_body", False)
        if len(body) > max_bytes:
            raise PayloadTooLarge(f"The body has more than {max_bytes} bytes.")
    request.has_empty_body = not body
    return bytes(body)
