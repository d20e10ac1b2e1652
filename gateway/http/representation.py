"""Representations of a resource: which there are, which one the client prefers, its bytes and its entity tag."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass

from gateway.base.errors import NotAcceptable
from gateway.extensions.pages.page import write
from gateway.extensions.pages.view import FORMATS
from gateway.extensions.things.documents import TD
from gateway.http.conditional import etag
from gateway.http.links import LINKSET_TYPES, Link, linkset_json, linkset_text
from gateway.http.negotiation import choose
from gateway.rdf.serialise import MEDIA_TYPES, WriteError, render
from gateway.rdf.vocabulary import PREFIXES
from gateway.resources.plain_json import JSON
from gateway.resources.resource import Resource

_PICKED = {name: media_type for name, (_, media_type) in FORMATS.items()} | {"json": JSON, "td": TD}


@dataclass(frozen=True)
class Representation:
    """A rendered representation with what identifies it."""

    body: bytes
    media_type: str

    @property
    def etag(self) -> str:
        return etag(self.body)

    @property
    def content_type(self) -> str:
        return self.media_type + ("; charset=utf-8" if self.media_type.startswith("text/") else "")


def negotiated(accept: str | None, resource: Resource, base: str) -> Representation:
    """The representation that Accept prefers; NotAcceptable with the list of what there is."""
    offered = _offered(resource)
    while media_type := choose(accept, offered):
        try:
            return _represent(resource, media_type, base)
        except WriteError:
            offered = tuple(each for each in offered if each != media_type)
    raise NotAcceptable(f"Available here: {', '.join(offered)}.", offered=offered)


def preferred(accept: str | None, picked: str | None) -> str | None:
    """What stands for Accept: a link cannot set it, so ``?as=turtle`` and its like pick one representation instead.

    NotAcceptable with the words that pick one, for any other.
    """
    if picked is None:
        return accept
    media_type = _PICKED.get(picked)
    if media_type is None:
        raise NotAcceptable(f"?as= picks one of {', '.join(_PICKED)}.", offered=tuple(_PICKED))
    return media_type


def etags(resource: Resource, base: str) -> Iterator[str]:
    """Of every representation, rendered as it is asked for: the client may have read JSON-LD and write Turtle."""
    for media_type in _offered(resource):
        with suppress(WriteError):
            yield _represent(resource, media_type, base).etag


def related(resource: Resource, base: str) -> list[Link]:
    """A link to each associated sub-resource (R0.9)."""
    return [Link(base + path, "related") for path in (*resource.own, *resource.parts)]


def _represent(resource: Resource, media_type: str, base: str) -> Representation:
    if resource.linkset_of is not None:
        anchor, links = base + resource.linkset_of.path, related(resource.linkset_of, base)
        write_links: Callable[..., bytes] = linkset_json if media_type == LINKSET_TYPES[0] else linkset_text
        return Representation(write_links(anchor, links), media_type)
    if media_type in resource.documents:
        return Representation(resource.documents[media_type](), media_type)
    triples = resource.whole(base).triples
    if media_type == "text/html":
        return Representation(write(resource, triples, base), media_type)
    return Representation(render(triples, media_type, PREFIXES, base=base + resource.path), media_type)


def _offered(resource: Resource) -> tuple[str, ...]:
    if resource.linkset_of is not None:
        return LINKSET_TYPES
    rdf = MEDIA_TYPES if resource.describe is not None else ()
    return (*rdf, *resource.documents)
