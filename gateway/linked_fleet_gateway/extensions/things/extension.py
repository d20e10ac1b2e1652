"""The extension ``things``: Thing Descriptions and their directory (W3C Web of Things).

The directory is served complete or by pages (W3C WoT Discovery, 7.3.2.3), and in RDF by pages. Listings are kept.
"""

import asyncio
import re
from collections.abc import AsyncIterator, Callable, Iterable, Mapping, Sequence
from contextlib import asynccontextmanager
from functools import partial
from hashlib import blake2b
from pathlib import Path
from typing import Any

from starlette.responses import Response, StreamingResponse

from linked_fleet_base.errors import BadRequest, NotAcceptable, Unimplemented
from linked_fleet_gateway.api import (
    Core,
    Extension,
    Mount,
    NavigationEntry,
    Request,
    RequestView,
    Resource,
    choose,
    read_resource,
    time_sliced,
)
from linked_fleet_gateway.extensions.things.directory import (
    MOST,
    MOST_LISTED,
    Listing,
    Place,
    RobotDigests,
    branches,
    describe_page,
)
from linked_fleet_gateway.extensions.things.kept_listings import InThread, KeptListing, KeptListings, LongListing
from linked_fleet_gateway.extensions.things.operations import operations
from linked_fleet_gateway.extensions.things.td import DIRECTORY, TD
from linked_fleet_gateway.serving import WebLink, link_header, not_modified
from linked_fleet_rdf.serialise import JSON

TYPES = ("application/ld+json", JSON)
_SORTING = ("sort_by", "sort_order")
_COUNT = re.compile(r"[0-9]{1,9}", re.ASCII)


class Directory:
    """The directory of one gateway, with the listings that it keeps."""

    def __init__(self, robots: Mapping[str, object], in_thread: InThread[KeptListing]) -> None:
        """Create it; ``robots`` are the present robots by name."""
        self._robots, self._digests, self._kept = robots, RobotDigests(), KeptListings(in_thread)

    async def read(self, request: Request, resource: Resource, listing: Listing) -> Response:
        """Return all descriptions or, with ``limit``, a page of them that links the next page and the complete list.

        In other media types it lists things by pages.
        """
        representations = request.services.representations
        types = (*TYPES, *(each for each in representations.media_types if each not in TYPES))
        media_type = choose(request.effective_accept, types)
        if media_type is None:
            raise NotAcceptable(f"Available here: {', '.join(types)}.", offered=types)
        if unsupported := [name for name in _SORTING if name in request.query_params]:
            raise Unimplemented(f"Descriptions are sorted by id, in ascending order; there is no {unsupported[0]}.")
        offset, limit = _count(request, "offset", 0) or 0, _count(request, "limit", 1)
        if media_type not in TYPES:
            describe = partial(
                describe_page, listing.view, await listing.things(), offset, min(limit or MOST_LISTED, MOST_LISTED)
            )
            return read_resource(request, resource.replace(describe=describe, remote=None))
        return await self._written(request, resource, listing, offset, limit, media_type)

    async def _written(
        self, request: Request, resource: Resource, listing: Listing, offset: int, limit: int | None, media_type: str
    ) -> Response:
        """Return the descriptions of a page, or of all things: from the cache, else made now."""
        version = await self._version(listing)
        key = version + repr((offset, limit)).encode()
        weak = _weak_tag(key)  # of a listing that is not kept: its body is not known before it is sent
        made: KeptListing | LongListing | None = self._kept.find(key)
        headers = {"vary": "Accept, Accept-Encoding", "cache-control": "no-cache", "x-content-type-options": "nosniff"}
        content = {"content-type": media_type, "allow": "GET, HEAD, OPTIONS"}
        if made is None:
            things = await listing.things()
            end = len(things) if limit is None else offset + min(limit, MOST)
            link = _page_links(request, resource, things, offset, limit, end)
            if not_modified(request.field("if-none-match"), weak):
                return Response(status_code=304, headers=headers | {"link": link, "etag": weak})

            async def is_current() -> bool:
                return await self._version(listing) == version

            parts = partial(_array, listing, things[offset:end])
            made = await self._kept.make(key, link, parts, is_current)
        headers["link"] = made.link
        if isinstance(made, LongListing):
            body = made.parts if request.method == "GET" else _nothing()
            return StreamingResponse(body, headers=headers | content | {"etag": weak})
        return made.content.response(request, headers | content)

    async def _version(self, listing: Listing) -> bytes:
        self._digests.forget_others(self._robots.keys())
        return await listing.version(self._digests)


def _weak_tag(key: bytes) -> str:
    return f'W/"{blake2b(key, digest_size=16).hexdigest()}"'


async def _nothing() -> AsyncIterator[bytes]:
    yield b""


def _page_links(
    request: Request,
    resource: Resource,
    things: Sequence[tuple[str, Place]],
    offset: int,
    limit: int | None,
    end: int,
) -> str:
    links = [WebLink(iri.value, "type") for iri in resource.interaction_model]
    links += _canonical(things, request.base, paged=limit is not None or offset > 0)
    if end < len(things):
        links.append(WebLink(f"{request.base}{DIRECTORY}?offset={end}&limit={limit}", "next"))
    return link_header(links, [])


def _canonical(things: Sequence[tuple[str, Place]], base: str, *, paged: bool) -> list[WebLink]:
    """Return the link of a page to the collection.

    Its etag changes when things are added or removed, which moves pages.
    """
    if not paged:
        return []
    state = blake2b("\n".join(id for id, _ in things).encode(), digest_size=16).hexdigest()
    return [WebLink(base + DIRECTORY, "canonical", etag=state)]


async def _array(listing: Listing, things: Iterable[tuple[str, Place]]) -> AsyncIterator[bytes]:
    """Yield a JSON array of descriptions, each of which takes milliseconds to render.

    If another description of a robot comes meanwhile, its further parts are left out.
    """
    separator = b"["
    async for id, place in time_sliced(things):
        if (said := listing.description(id, place)) is not None:
            yield separator + said
            separator = b",\n"
    yield b"]" if separator != b"[" else b"[]"


def _count(request: Request, name: str, least: int) -> int | None:
    text = request.query_params.get(name)
    if text is None:
        return None
    if not _COUNT.fullmatch(text) or int(text) < least:
        raise BadRequest(f"{name} is a whole number, at least {least}.")
    return int(text)


async def _in_thread(made: Callable[[], KeptListing], size: int) -> KeptListing:
    return await asyncio.to_thread(made)


class ThingsExtension(Extension):
    name = "things"
    vocabulary = (Path(__file__).with_name("vocabulary.ttl"),)
    at_root = (".well-known", "things")
    navigation = (NavigationEntry("Things", "/things", 60, for_developers=True),)

    def views(self) -> Sequence[object]:
        from linked_fleet_gateway.extensions.things import page

        return (page.VIEW,)

    def operations(self, view: RequestView) -> Mapping[str, Mapping[str, Any]]:
        return operations(view)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        directory = Directory(core.robots, _in_thread)
        yield Mount(
            branches=branches(lambda: core.live.branches.containers),
            readers={Listing: directory.read},
            formats={"td": ("Thing Description", TD)},
        )
