"""Representations of a resource: the available ones, negotiation, bytes, entity tags, and preconditions.

Entity tags and preconditions follow RFC 9110, 8.8.3, 13.1.1 and 13.1.2.
"""

import re
from collections.abc import AsyncIterator, Callable, Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from hashlib import blake2b
from typing import TypeVar

from linked_fleet_base.errors import NotAcceptable
from linked_fleet_gateway.http.fields import LINKSET_TYPES, Link, linkset_json, linkset_text
from linked_fleet_gateway.http.negotiation import choose
from linked_fleet_gateway.http.scheduling import Offload
from linked_fleet_gateway.resources.html import HTML, Context, Formats, HtmlWriter, PageContext
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.templates import Rendering, Templates
from linked_fleet_rdf.forms import render_graph
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.serialise import JSON, RDF_TYPES, WriteError
from linked_fleet_rdf.templates import Document
from linked_fleet_rdf.vocabulary import PREFIXES
from linked_fleet_runtime.background import time_sliced

_TAG = re.compile(r'(W/)?("[\x21\x23-\x7e\x80-\xff]*")')
_CODED = re.compile(r'-(?:gzip|br)"$')
_LIST = re.compile(rf"[ \t,]*(?:{_TAG.pattern}[ \t]*(?:,[ \t,]*|$))*")


def etag(body: bytes) -> str:
    """Return the strong entity tag of these bytes."""
    return f'"{blake2b(body, digest_size=16).hexdigest()}"'


def not_modified(if_none_match: str | None, etag: str) -> bool:
    """Return True if the client has this representation already: ``*`` or weak comparison (13.1.2).

    ``etag`` is that of the selected representation, in its content coding (8.8.3.3).
    """
    if if_none_match is None:
        return False
    opaque = etag.removeprefix("W/")
    return if_none_match.strip() == "*" or any(tag == opaque for _, tag in _tags(if_none_match))


def names_state(if_none_match: str | None, etag: str) -> bool:
    """Return True if ``If-None-Match`` of a write names this state of the resource, in any content coding."""
    if if_none_match is None:
        return False
    opaque = _plain(etag.removeprefix("W/"))
    return if_none_match.strip() == "*" or any(_plain(tag) == opaque for _, tag in _tags(if_none_match))


def precondition_holds(if_match: str | None, etags: Collection[str], *, exists: bool = True) -> bool:
    """Return True if a write may proceed: ``*`` if the resource exists, or a current tag (13.1.1)."""
    if if_match is None:
        return True
    if if_match.strip() == "*":
        return exists
    strong = {_plain(tag) for tag in etags if not tag.startswith("W/")}
    return exists and any(_plain(tag) in strong for weak, tag in _tags(if_match) if not weak)


def _tags(field: str) -> list[tuple[str, str]]:
    """Return the tags of a well-formed list. A malformed one has none, which is safe in both directions."""
    return _TAG.findall(field) if _LIST.fullmatch(field) else []


def _plain(tag: str) -> str:
    """Return the tag without its content coding, so that readers of coded representations can write."""
    return _CODED.sub('"', tag)


_A = TypeVar("_A", str, str | None)
Write = Callable[[_A, Resource, str, Context, Graph], "Representation"]

FORMATS: Formats = {
    "turtle": ("Turtle", "text/turtle"),
    "jsonld": ("JSON-LD", "application/ld+json"),
    "ntriples": ("N-Triples", "application/n-triples"),
    "rdfxml": ("RDF/XML", "application/rdf+xml"),
    "jelly": ("Jelly", "application/x-jelly-rdf"),
    "json": ("JSON", JSON),
}


@dataclass(frozen=True)
class Representation:
    """A rendered representation with its media type.

    ``document``: its content with the template that was filled in, if that is known.
    """

    body: bytes
    media_type: str
    document: Document | None = field(default=None, compare=False)

    @property
    def etag(self) -> str:
        return etag(self.body)

    @property
    def content_type(self) -> str:
        return content_type(self.media_type)


def content_type(media_type: str) -> str:
    """Return the value of Content-Type."""
    return media_type + ("; charset=utf-8" if media_type.startswith("text/") else "")


class Representations:
    """All representations of a gateway. ``html`` renders pages, if available; ``formats`` are those of extensions."""

    def __init__(self, html: HtmlWriter | None = None, formats: Formats | None = None) -> None:
        self.html = html
        self.formats: Mapping[str, tuple[str, str]] = {**FORMATS, **(formats or {})}
        """Label and media type by word."""
        self.media_types = RDF_TYPES if html is None else (*RDF_TYPES, HTML)
        """Media types of all resources described in RDF, in order of preference."""
        self.templates = Templates()

    async def negotiate_interleaved(
        self, accept: str | None, resource: Resource, base: str, context: Context, threads: Offload
    ) -> Representation:
        """Return the representation that Accept prefers. Other requests get turns if it takes long.

        Raises as ``negotiate``, and Busy.
        """
        media_type = self.choose_media_type(accept, resource)
        if media_type is None or not self._is_long(resource, media_type):
            return self.negotiate(accept, resource, base, context)
        return await self._in_thread(self.negotiate, accept, resource, base, context, threads)

    def choose_media_type(self, accept: str | None, resource: Resource) -> str | None:
        """Return the media type that Accept prefers; None if it excludes all."""
        return choose(accept, self._offered(resource))

    def negotiate(
        self,
        accept: str | None,
        resource: Resource,
        base: str,
        context: Context = PageContext,
        graph: Graph | None = None,
    ) -> Representation:
        """Return the representation that Accept prefers. Raises NotAcceptable with the available types.

        ``context`` returns that of the page. ``graph``: the description, if it is there.
        """
        offered = self._offered(resource)
        while media_type := choose(accept, offered):
            try:
                return self._represent(media_type, resource, base, context, graph)
            except WriteError:
                offered = tuple(each for each in offered if each != media_type)
        raise NotAcceptable(f"Available here: {', '.join(offered)}.", offered=offered)

    def override_accept(self, accept: str | None, picked: str | None) -> str | None:
        """Return the value that replaces Accept: links use ``?as=turtle`` and similar, because they cannot set fields.

        Raises NotAcceptable with the valid words for any other.
        """
        if picked is None:
            return accept
        if picked not in self.formats:
            raise NotAcceptable(f"?as= picks one of {', '.join(self.formats)}.", offered=tuple(self.formats))
        return self.formats[picked][1]

    def rendering(self, resource: Resource, media_type: str, base: str) -> Rendering | None:
        """Return the rendering of measured values; None without any, or if the media type has none."""
        return None if media_type in resource.documents else self.templates.rendering(resource, media_type, base)

    def is_quick(self, accept: str | None, resource: Resource, base: str) -> bool:
        """Return True if the preferred representation has a known template."""
        media_type = self.choose_media_type(accept, resource)
        return (
            media_type is not None
            and media_type not in resource.documents
            and self.templates.is_known(resource, media_type, base)
        )

    def forget_robot(self, robot: str) -> None:
        """Drop the templates of a robot that was removed."""
        self.templates.forget_robot(robot)

    def etags(self, resource: Resource, base: str, context: Context = PageContext) -> Iterator[str]:
        """Yield the tags of all representations, rendered on demand: a client may read JSON-LD and write Turtle."""
        for media_type in self._offered(resource):
            with suppress(WriteError):
                yield self._represent(media_type, resource, base, context).etag

    async def etags_interleaved(
        self, resource: Resource, base: str, context: Context, threads: Offload
    ) -> AsyncIterator[str]:
        """Yield the tags like ``etags``. Other requests get turns."""
        async for media_type in time_sliced(self._offered(resource)):
            with suppress(WriteError):
                if self._is_long(resource, media_type):
                    found = await self._in_thread(self._represent, media_type, resource, base, context, threads)
                else:
                    found = self._represent(media_type, resource, base, context)
                yield found.etag

    def _is_long(self, resource: Resource, media_type: str) -> bool:
        """Return True if a representation takes more than a few milliseconds."""
        document = resource.rendition(media_type)
        return resource.is_long or media_type == HTML if document is None else document.is_long

    async def _in_thread(
        self, make: Write[_A], asked: _A, resource: Resource, base: str, context: Context, threads: Offload
    ) -> Representation:
        """Write a description in a thread; it is made in steps here, because a thread must not read the live fleet."""
        graph = Graph()
        async for _ in time_sliced(resource.describe_in_steps(graph, base)):
            pass
        return await threads.run(partial(make, asked, resource, base, context, graph), len(graph.statements) + 1, 0)

    def _represent(
        self, media_type: str, resource: Resource, base: str, context: Context, graph: Graph | None = None
    ) -> Representation:
        if resource.linkset_of is not None:
            anchor, links = base + resource.linkset_of.path, related_links(resource.linkset_of, base)
            write_links: Callable[..., bytes] = linkset_json if media_type == LINKSET_TYPES[0] else linkset_text
            return Representation(write_links(anchor, links), media_type)
        if media_type in resource.documents:
            return Representation(resource.documents[media_type](), media_type)
        if (rendering := self.rendering(resource, media_type, base)) is not None:
            return Representation(rendering.render_current(), media_type)
        if (filled := self.templates.document(resource, media_type, base)) is not None:
            return Representation(filled.content, media_type, filled)
        graph = graph or resource.full_graph(base)
        if media_type == HTML and self.html is not None:
            page = self.html.write_resource(resource, graph.triples, base, self.formats, context())
            return Representation(page, media_type)
        document = render_graph(graph, media_type, PREFIXES, base=base + resource.path)
        return Representation(document.content, media_type, document)

    def _offered(self, resource: Resource) -> tuple[str, ...]:
        if resource.linkset_of is not None:
            return LINKSET_TYPES
        rdf = self.media_types if resource.describe is not None else ()
        return (*rdf, *resource.documents)


def typed_links(resource: Resource, base: str) -> list[Link]:
    """Return the links of a resource with specific relations."""
    return [Link(base + each.path, each.relation, each.media_type) for each in resource.typed_links]


def related_links(resource: Resource, base: str) -> list[Link]:
    """Return the links of its link set: those with specific relations, and one to each sub-resource (R0.9)."""
    return typed_links(resource, base) + [
        Link(base + path, "related") for path in (*resource.own_paths, *resource.part_paths)
    ]
