"""The interaction model that a client asks for of what it writes: ``Link; rel="type"`` (LDP 5.2.3.4 and 4.2.1.4)."""

import re

from linked_fleet_gateway.base.errors import UnprocessableContent
from linked_fleet_gateway.http.fields import field, parameters, split
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.rdf.vocabulary import LDP
from linked_fleet_gateway.resources.resource import Resource

_MODELS = (LDP.Resource.value, LDP.RDFSource.value)
# One link (RFC 8288, 3): the target, then parameters, in which quoted strings are swallowed whole.
_LINK = re.compile(r'<([^<>]*+)>((?:[^",]++|"(?:[^"\\]++|\\.)*+")*+)')


def check_model(request: Request, resource: Resource) -> None:
    """UnprocessableContent for a model that is not had: what clients make here are RDF sources, and no containers.

    Actions and queries make no resource in the place of the one that is written to.
    """
    if not resource.interaction or resource.remote is not None or request.method not in ("POST", "PUT"):
        return
    others = [each for each in _types(field(request, "link") or "") if each.startswith(LDP.iri) and each not in _MODELS]
    if others:
        raise UnprocessableContent(
            f"What is written here is a plain {LDP.RDFSource.value}; the model <{others[0][:200]}> is not to be had."
        )


def _types(header: str) -> list[str]:
    """The targets of links of the type ``type`` from the resource itself; what is malformed is no link."""
    found = []
    for target, rest in _LINK.findall(header):
        said = [each for each in parameters(split(rest, ";")) if each is not None]
        relations = next((value for name, value in said if name == "rel"), "").lower().split()
        if "type" in relations and not any(name == "anchor" for name, _ in said):
            found.append(target.strip())
    return found
