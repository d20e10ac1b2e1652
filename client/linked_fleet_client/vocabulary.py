"""The vocabularies that a client of Linked Robotic Things reads, and short names of IRIs."""

import re
from urllib.parse import unquote

import rdflib
from rdflib import Namespace
from rdflib.term import Node, URIRef

# RFC 3987 excludes these characters from IRIs, but parsers may accept them.
_WEB = re.compile(r"""https?://[^\x00-\x20<>"{}|\\^`\x7f]+""", re.IGNORECASE)

HYBRIT = Namespace("https://hybr-it-projekt.de/ns/hybr-it#")
LF = Namespace("https://w3id.org/linked-fleet#")
LDP = Namespace("http://www.w3.org/ns/ldp#")
HTTP = Namespace("http://www.w3.org/2011/http#")
VOM = Namespace("http://vocab.arvida.de/2015/06/vom/vocab#")
MATHS = Namespace("http://vocab.arvida.de/2015/06/maths/vocab#")
QUDT = Namespace("http://qudt.org/schema/qudt/")
UNIT = Namespace("http://qudt.org/vocab/unit/")
DCTERMS, PROV, RDF, RDFS, SH, SOSA, XSD = (
    rdflib.DCTERMS,
    rdflib.PROV,
    rdflib.RDF,
    rdflib.RDFS,
    rdflib.SH,
    rdflib.SOSA,
    rdflib.XSD,
)


def local_name(iri: str) -> str:
    """Return the text after the last ``#``, ``/`` or ``:``, percent-decoded; a trailing slash is ignored."""
    tail = iri.split("?")[0].rstrip("/#")
    for separator in "#/:":
        tail = tail.rpartition(separator)[2]
    return unquote(tail) or iri


def is_web(term: Node | None) -> bool:
    """Return True if the term is an IRI that can be requested over HTTP; other terms are never fetched."""
    return isinstance(term, URIRef) and _WEB.fullmatch(term) is not None


def document_of(iri: str) -> str:
    """Return the IRI without its fragment, which is the URL to request."""
    return iri.partition("#")[0]
