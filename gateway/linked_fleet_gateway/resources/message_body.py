"""The bodies of messages: the representation that GET returns, plus the version of the resource."""

from pyoxigraph import NamedNode

from linked_fleet_gateway.resources.resource import Rendition, Resource
from linked_fleet_gateway.resources.subscription_resource import describe_version
from linked_fleet_gateway.resources.templates import Versions
from linked_fleet_rdf.forms import render_graph
from linked_fleet_rdf.serialise import RDF_TYPES, WriteError
from linked_fleet_rdf.vocabulary import PREFIXES


def message_types(resource: Resource) -> tuple[str, ...]:
    """Return the media types of messages about ``resource``: no HTML, and Turtle first (R1.2)."""
    if not resource.observable:
        return ()
    constant = {name for name, each in resource.documents.items() if isinstance(each, Rendition) and each.is_constant}
    return (*RDF_TYPES, *(each for each in resource.documents if each not in constant))


def message_body(resource: Resource, media_type: str, base: str, versions: Versions) -> bytes:
    """Return the bytes of a message. Raises WriteError if the syntax cannot represent the triples."""
    if media_type in resource.documents:
        return resource.documents[media_type]()
    if media_type not in RDF_TYPES:
        raise WriteError(f"there is no {media_type} of {resource.path} at present")
    graph = resource.full_graph(base)
    describe_version(graph, NamedNode(base + resource.path), *versions)
    return render_graph(graph, media_type, PREFIXES, base=base + resource.path).content
