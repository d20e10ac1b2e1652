"""The interaction model that a client requests with a write: ``Link; rel="type"`` (LDP 5.2.3.4 and 4.2.1.4)."""

import re

from linked_fleet_gateway.base.errors import UnprocessableContent
from linked_fleet_gateway.http.fields import field, parameters, split
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.rdf.vocabulary import LDP
from linked_fleet_gateway.resources.resource import Resource

_MODELS = (LDP.Resource.value, LDP.RDFSource.value)
# One link (RFC 8288, 3): the target, then parameters, in which quoted strings are consumed whole.
_LINK = re.compile(r'<([^<>]*+)>((?:[^",]++|"(?:[^"\\]++|\\.)*+")*+)')


def check_model(request: Request, resource: Resource) -> None:
    """Raise UnprocessableContent for an unavailable model: clients can create RDF sources but no containers.

    Actions and queries are exempt, because they do not replace the resource.
    """
    if not resource.interaction or resource.remote is not None or request.method not in ("POST", "PUT"):
        return
    others = [each for each in _types(field(request, "link") or "") if each.startswith(LDP.iri) and each not in _MODELS]
    if others:
        raise UnprocessableContent(
            f"What is written here is a plain {LDP.RDFSource.value}; the model <{others[0][:200]}> is not to be had."
        )


def _types(header: str) -> list[str]:
    """Return the targets of links with relation ``type`` from the resource itself; malformed links are ignored."""
    found = []
    for target, rest in _LINK.findall(header):
        said = [each for each in parameters(split(rest, ";")) if each is not None]
        relations = next((value for name, value in said if name == "rel"), "").lower().split()
        if "type" in relations and not any(name == "anchor" for name, _ in said):
            found.append(target.strip())
    return found
