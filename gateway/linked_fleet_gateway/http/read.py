"""GET of a resource: common header fields, and the representation that the client prefers.

The client may prefer a part of a container (LDP 7.2): the container itself, its members, or both.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial

from pyoxigraph import NamedNode
from starlette.datastructures import MutableHeaders
from starlette.responses import Response

from linked_fleet_gateway.http.answers import CachedResponse, ReadyResponse
from linked_fleet_gateway.http.callers import mark_private
from linked_fleet_gateway.http.fields import Link, field, link_header, parse_prefer
from linked_fleet_gateway.http.negotiation import (
    MOST_BYTES,
    accepts_gzip,
    coded_tag,
    compress,
    is_compressible,
    preferred_coding,
)
from linked_fleet_gateway.http.page_context import page_context
from linked_fleet_gateway.http.representation import (
    Representation,
    content_type,
    not_modified,
    typed_links,
)
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.http.writes import patch_types
from linked_fleet_gateway.resources.body_values import own_statements
from linked_fleet_gateway.resources.description import InSteps
from linked_fleet_gateway.resources.html import HTML, Context, PageContext
from linked_fleet_gateway.resources.paths import robot_of
from linked_fleet_gateway.resources.resource import CONTAINER, Resource
from linked_fleet_gateway.resources.templates import Rendering, is_measured
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.serialise import RDF_TYPES, WriteError
from linked_fleet_rdf.templates import Document
from linked_fleet_rdf.vocabulary import LDP
from linked_fleet_server.exchange import Reply
from linked_fleet_state.robot import Robot

_MINIMAL, _CONTAINMENT = LDP.PreferMinimalContainer.value, LDP.PreferContainment.value
# A basic container has no membership triples other than containment, so omitting them changes nothing.
_PARTS = frozenset({_MINIMAL, _CONTAINMENT, LDP.PreferMembership.value})


_AT_ONCE = 256
"""Triples that are looked at in one step."""


@dataclass(frozen=True)
class ContainerPart:
    """The shown triples: those about the container itself, and ``ldp:contains`` with descriptions of members."""

    minimal: bool
    containment: bool


def preferred_part(request: Request, resource: Resource) -> ContainerPart | None:
    """Return the preferred part; None for all, without a known preference or with a contradictory one."""
    preferences = field(request, "prefer")
    if preferences is None or resource.interaction_model != CONTAINER or request.method not in ("GET", "HEAD"):
        return None
    prefer = parse_prefer(preferences)
    include, omit = prefer.include & _PARTS, prefer.omit & _PARTS
    if prefer.return_ != "representation" or not (include or omit) or include & omit:
        return None
    wants = _CONTAINMENT in include or _MINIMAL not in include
    part = ContainerPart(_MINIMAL not in omit, wants and _CONTAINMENT not in omit)
    return part if part.minimal or part.containment else None


def restrict_to_part(resource: Resource, part: ContainerPart, base: str) -> Resource:
    """Return the container with this part of its description, which has an entity tag of its own."""
    return resource.replace(describe=InSteps(partial(_steps, resource, part, NamedNode(base + resource.path))))


def _steps(resource: Resource, part: ContainerPart, iri: NamedNode, graph: Graph) -> Iterator[None]:
    whole = Graph()
    yield from resource.own_steps(whole)
    about = set(own_statements(whole.triples, iri))
    for number, triple in enumerate(whole.triples):
        if number % _AT_ONCE == 0:
            yield
        minimal = triple in about and (triple.subject != iri or triple.predicate != LDP.contains)
        if part.minimal if minimal else part.containment:
            graph.add(triple.subject, triple.predicate, triple.object)  # type: ignore[arg-type]


# The header block stays under 4 KiB, and Link is not its only field.
_LINK_BYTES = 3584
READ_METHODS = ("GET", "HEAD", "OPTIONS")
# Foreign XML and meshes: a browser that takes one for a document must not execute anything.
_NOTHING = "sandbox; default-src 'none'"
_FOR_EVER = "public, max-age=31536000, immutable"


def read_resource(request: Request, resource: Resource) -> Response:
    """Return the representation that the client prefers, or 304. Raises NotAcceptable."""
    context = partial(page_context, request, resource.path)
    representation = request.services.representations.negotiate(*_asked(request, resource), context)
    return _response(request, resource, context, representation, MOST_BYTES)


async def read_interleaved(request: Request, resource: Resource) -> Response:
    """Return the same as ``read_resource``.

    Other requests get turns if it takes long, and long contents are compressed too.
    """
    asked, threads = _asked(request, resource), request.services.writing_offload
    context = partial(page_context, request, resource.path)
    representation = await request.services.representations.negotiate_interleaved(*asked, context, threads)
    body, coded = representation.body, b""
    is_long = len(body) > MOST_BYTES and not _stored_codings(resource, representation.media_type)
    coding = _coding(request, resource, context, representation, len(body)) if is_long else ""
    if coding and not not_modified(field(request, "if-none-match"), coded_tag(representation.etag, coding)):
        coded = await threads.run(partial(compress, body), len(body), MOST_BYTES)
    return _response(request, resource, context, representation, len(body), coded)


def _asked(request: Request, resource: Resource) -> tuple[str | None, Resource, str]:
    """Return the accepted media types, the resource and its base."""
    return request.effective_accept, resource, request.base


def read_nowait(request: Request, resource: Resource) -> Reply | None:
    """Return the response of ``read_resource`` if it takes no more than some milliseconds and is cached for the next
    requests.

    Raises NotAcceptable.
    """
    representations, asked = request.services.representations, _asked(request, resource)
    media_type = representations.choose_media_type(*asked[:2])
    if resource.is_long or not _is_cacheable(request, resource, media_type):
        return None
    assert media_type is not None  # otherwise nothing is cacheable
    if (rendering := representations.rendering(resource, media_type, request.base)) is not None:
        with suppress(WriteError):
            return _cached(request, resource, media_type, rendering)
        return None
    representation = representations.negotiate(*asked)
    if representation.media_type != media_type:  # the chosen syntax cannot express it
        return None
    return _cached(request, resource, media_type, representation.document or Document(representation.body))


def _response(
    request: Request,
    resource: Resource,
    context: Context,
    representation: Representation,
    most: int,
    coded: bytes = b"",
) -> Response:
    """Return the representation in the preferred coding, or 304. Contents above ``most`` bytes have no coding.

    ``coded``: its content in the coding, if that is known.
    """
    media_type = representation.media_type
    if _is_cacheable(request, resource, media_type):
        rendering = request.services.representations.rendering(resource, media_type, request.base)
        document = representation.document or Document(representation.body)
        return ReadyResponse(_cached(request, resource, media_type, document if rendering is None else rendering))
    headers, of_content = _fields(request, resource, media_type, context)
    tag, body = representation.etag, representation.body
    coding = _coding(request, resource, context, representation, most)
    headers["etag"] = coded_tag(tag, coding)
    if not_modified(field(request, "if-none-match"), headers["etag"]):
        return Response(status_code=304, headers=headers)
    if coding:
        headers["content-encoding"] = coding
        body = coded or _stored_codings(resource, media_type).get(coding) or compress(body)
    # Starlette computes Content-Length from the body; the server leaves out the body of a HEAD.
    return Response(body, headers=headers | of_content)


def _fields(
    request: Request, resource: Resource, media_type: str, context: Context = PageContext
) -> tuple[dict[str, str], dict[str, str]]:
    """Return the fields of every response, with an empty ETag, and those that a 304 does not have."""
    representations = request.services.representations
    headers = resource_headers(resource, request.base, "")
    headers["vary"] += ", Accept-Encoding"
    if media_type not in resource.documents and preferred_part(request, resource) is not None:
        headers["preference-applied"] = "return=representation"
    if media_type == HTML and representations.html is not None:
        headers["vary"] += ", Accept-Language, Cookie"
        headers["content-language"] = representations.html.language(context().reader)
        headers["content-security-policy"] = representations.html.content_security_policy(
            bool(resource.has_form or context().reader.name)
        )
    elif media_type.endswith("xml"):
        headers["content-security-policy"] = _NOTHING
    of_content = {"content-type": content_type(media_type)}
    document = resource.rendition(media_type)
    if document is not None and document.file_name:
        of_content["content-disposition"] = f'attachment; filename="{document.file_name}"'
    return headers, of_content | method_headers(resource, allowed_methods(resource))


def accepted_codings(request: Request) -> bytes:
    """Return the Accept-Encoding field; empty without one."""
    return (field(request, "accept-encoding") or "").encode("latin-1")


def _coding(request: Request, resource: Resource, context: Context, representation: Representation, most: int) -> str:
    """Return the content coding that the client prefers; empty for none. Contents above ``most`` bytes have none."""
    return preferred_coding(accepted_codings(request), _codings(resource, context, representation, most))


def _stored_codings(resource: Resource, media_type: str) -> Mapping[str, bytes]:
    """Return the codings in which the document is there already."""
    document = resource.rendition(media_type)
    return {} if document is None else document.codings


def _codings(resource: Resource, context: Context, representation: Representation, most: int) -> tuple[str, ...]:
    """Return the available content codings of a representation."""
    media_type = representation.media_type
    if stored := _stored_codings(resource, media_type):
        return tuple(stored)
    text = media_type.startswith("text/") or media_type.endswith(("json", "xml", "n-triples"))
    secret = media_type == HTML and bool(context().reader.name)
    coded = text and not secret and is_compressible(representation.body, resource.shows_values, most)
    return ("gzip",) if coded else ()


def _is_cacheable(request: Request, resource: Resource, media_type: str | None) -> bool:
    """Return True if the response can be cached: RDF that lasts, or of a robot and with changes that are known."""
    if media_type not in RDF_TYPES or media_type in resource.documents or resource.linkset_of is not None:
        return False
    if not is_measured(resource, media_type) and (resource.source.is_measured or not resource.publishes_changes):
        return False
    known = resource.source.shown is not None or _robot(request, resource) is not None
    return known and request.services.response_cache.is_cacheable(request.scope)


def _robot(request: Request, resource: Resource) -> Robot | None:
    """Return the robot with which the resource changes or ends."""
    if resource.source.robot is None and resource.template is not None:  # a constant blueprint
        return request.services.live.fleet.robots.get(robot_of(resource.path) or "")
    return resource.source.robot


def _cached(request: Request, resource: Resource, media_type: str, written: Document | Rendering) -> Reply:
    """Cache the response to a request for which ``_is_cacheable`` is true. Raises WriteError for a rendering."""
    services = request.services
    headers, of_content = _fields(request, resource, media_type)
    del headers["etag"]
    stated = MutableHeaders(headers)
    if services.identities is not None:
        mark_private(resource.path, stated)
    always, more = stated.raw, MutableHeaders(of_content).raw
    answer = CachedResponse(resource, _robot(request, resource), written, always, more)
    plain = written.content if isinstance(written, Document) else None
    known, in_gzip = request.arrival.fields.get(b"if-none-match"), accepts_gzip(accepted_codings(request))
    reply = answer.reply(known, in_gzip, plain)
    assert reply is not None  # the document holds its template
    services.response_cache.store(request.scope, answer)
    return reply


def resource_headers(resource: Resource, base: str, etag: str) -> dict[str, str]:
    """Return the fields of every response to GET of the resource."""
    headers = {
        "etag": etag,
        "vary": "Accept, Prefer" if resource.interaction_model == CONTAINER else "Accept",
        "cache-control": _FOR_EVER if resource.immutable else "no-cache",
        "x-content-type-options": "nosniff",
    }
    link = _link(resource, base)
    return headers | {"link": link} if link else headers


def allowed_methods(resource: Resource) -> tuple[str, ...]:
    """Return the methods of the resource."""
    if resource.affords is None:
        return READ_METHODS
    methods = (*READ_METHODS, *resource.affords.methods)
    return methods if "PATCH" not in methods or patch_types() else tuple(each for each in methods if each != "PATCH")


def method_headers(resource: Resource, allow: Sequence[str]) -> dict[str, str]:
    """Return ``Allow`` and the media types of bodies."""
    headers = {"allow": ", ".join(allow)}
    if resource.affords is not None and (taken := resource.affords.body_types):
        fields = {"POST": "accept-post", "PUT": "accept-put"}
        headers |= {fields[method]: ", ".join(taken) for method in allow if method in fields}
        headers |= {"accept-patch": ", ".join(patch_types())} if "PATCH" in allow else {}
    return headers


def _link(resource: Resource, base: str) -> str:
    types = [Link(iri.value, "type") for iri in resource.interaction_model]
    layout = [] if resource.layout_path is None else [Link(base + resource.layout_path, "describedby")]
    own = types + layout + typed_links(resource, base) + [Link(base + path, "related") for path in resource.own_paths]
    parts = [Link(base + path, "related") for path in resource.part_paths]
    linkset = base + resource.linkset_path if resource.has_linkset else None
    return link_header(own, parts, linkset, limit=_LINK_BYTES)
