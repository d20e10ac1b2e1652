"""Problem details (RFC 9457): JSON unless the client would rather have RDF, with the SHACL report in either."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from gateway.base.errors import FleetError
from gateway.extensions.pages.page import render as render_page
from gateway.extensions.pages.policy import POLICY
from gateway.http.negotiation import choose, parse_accept, weight
from gateway.rdf.serialise import MEDIA_TYPES, render
from gateway.rdf.vocabulary import DCTERMS, LF, RDF, SH, XSD

PROBLEM_JSON = "application/problem+json"
# RFC 9457 calls nothing like them; the names are those of the SHACL vocabulary without the word "result"
_REPORTED = {
    SH.focusNode: "focusNode",
    SH.resultPath: "path",
    SH.resultMessage: "message",
    SH.value: "value",
    SH.sourceConstraintComponent: "sourceConstraintComponent",
}


def problem(
    error: FleetError, accept: str | None, instance: str | None, prefixes: Mapping[str, str]
) -> tuple[bytes, dict[str, str]]:
    """Body and header fields, those that the error itself brings included."""
    body, content_type = problem_body(error, accept, instance, prefixes)
    own = {name.lower(): value for name, value in error.headers.items()}
    headers = {"content-type": content_type, "vary": "Accept", "cache-control": "no-store"}
    if content_type.startswith("text/html"):
        headers |= {"content-security-policy": POLICY, "x-content-type-options": "nosniff"}
    return body, headers | own


def problem_body(
    error: FleetError, accept: str | None, instance: str | None, prefixes: Mapping[str, str]
) -> tuple[bytes, str]:
    """Body and content type. A client that accepts none of ours still gets JSON (RFC 9110, 15.5.7)."""
    media_type = choose(_preferring_json(accept), (PROBLEM_JSON, *MEDIA_TYPES)) or PROBLEM_JSON
    if media_type == PROBLEM_JSON:
        return _json(error, instance), PROBLEM_JSON
    if media_type == "text/html":
        members = {name: value for name, value in error.members.items() if value}
        said = _report(error.report) if error.report else []
        page = render_page("problem.html", error=error, instance=instance, members=members, report=said)
        return page, f"{media_type}; charset=utf-8"
    body = render(_triples(error), media_type, prefixes, base=instance or "")
    return body, f"{media_type}; charset=utf-8" if media_type.startswith("text/") else media_type


def _preferring_json(accept: str | None) -> str | None:
    """``application/json`` is as good as its problem flavour: who asks for it can read that."""
    ranges = parse_accept(accept)
    as_json, as_problem = weight(ranges, "application/json"), weight(ranges, PROBLEM_JSON)
    return f"{accept}, {PROBLEM_JSON};q={as_json:.3f}" if as_json > as_problem else accept


def _json(error: FleetError, instance: str | None) -> bytes:
    members: dict[str, Any] = {
        "type": error.type,
        "title": error.title,
        "status": error.status,
        "detail": error.detail,
    }
    members |= {"instance": instance} if instance else {}
    members |= error.members
    members |= {"report": _report(error.report)} if error.report else {}
    return json.dumps(members, ensure_ascii=False).encode()


def _report(triples: Sequence[Triple]) -> list[dict[str, str]]:
    """The results of a SHACL report in order, one flat object each; blank nodes, which mean nothing here, left out."""
    results: dict[Any, dict[str, str]] = {t.object: {} for t in triples if t.predicate == SH.result}
    for triple in triples:
        member = _REPORTED.get(triple.predicate)
        if member and triple.subject in results and isinstance(triple.object, NamedNode | Literal):
            results[triple.subject].setdefault(member, triple.object.value)
    return list(results.values())


def _triples(error: FleetError) -> list[Triple]:
    problem = BlankNode()
    status = Literal(str(error.status), datatype=XSD.integer)
    return [
        Triple(problem, RDF.type, LF.Problem),
        Triple(problem, DCTERMS.identifier, Literal(error.type, datatype=XSD.anyURI)),
        Triple(problem, LF.status, status),
        Triple(problem, DCTERMS.title, Literal(error.title)),
        Triple(problem, DCTERMS.description, Literal(error.detail)),
        *(error.report or ()),
    ]
