"""The directory of Thing Descriptions, a part at a time (W3C WoT Discovery, 7.3.2.3)."""

import asyncio
import re

from starlette.requests import Request
from starlette.responses import Response

from gateway.errors import BadRequest, NotAcceptable
from gateway.graph.resource import Resource
from gateway.http.conditional import etag, not_modified
from gateway.http.fields import field
from gateway.http.links import Link, link_header
from gateway.http.negotiation import choose
from gateway.things.directory import Listing
from gateway.things.documents import DIRECTORY, JSON, MOST

TYPES = ("application/ld+json", JSON)
_COUNT = re.compile(r"[0-9]{1,9}", re.ASCII)


async def read_listing(request: Request, resource: Resource, listing: Listing, base: str) -> Response:
    """``offset`` and ``limit`` say which part; a link says where the next one is."""
    media_type = choose(field(request, "accept"), TYPES)
    if media_type is None:
        raise NotAcceptable(f"Available here: {', '.join(TYPES)}.", offered=TYPES)
    offset = _count(request, "offset", 0, 0)
    limit = min(_count(request, "limit", MOST, 1), MOST)
    found = []
    for each in listing.written(offset, limit + 1):
        found.append(each)
        await asyncio.sleep(0)  # one takes milliseconds, and others want to go on meanwhile
    body = b"[" + b",\n".join(found[:limit]) + b"]"
    tag = etag(body)
    headers = {"etag": tag, "vary": "Accept", "cache-control": "no-cache", "x-content-type-options": "nosniff"}
    links = [Link(iri.value, "type") for iri in resource.interaction]
    if len(found) > limit:
        links.append(Link(f"{base}{DIRECTORY}?offset={offset + limit}&limit={limit}", "next"))
    headers["link"] = link_header(links, [])
    if not_modified(field(request, "if-none-match"), tag):
        return Response(status_code=304, headers=headers)
    return Response(body, headers=headers | {"content-type": media_type, "allow": "GET, HEAD, OPTIONS"})


def _count(request: Request, name: str, otherwise: int, least: int) -> int:
    text = request.query_params.get(name)
    if text is None:
        return otherwise
    if not _COUNT.fullmatch(text) or int(text) < least:
        raise BadRequest(f"{name} is a whole number, at least {least}.")
    return int(text)
