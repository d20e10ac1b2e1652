"""Problem details (RFC 9457): JSON by default, or RDF, both with the SHACL report."""

import json
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

from pyoxigraph import BlankNode, Literal

from linked_fleet_base.errors import PROBLEM_JSON, FleetError, Statement, TooManyRequests
from linked_fleet_gateway.http.negotiation import choose
from linked_fleet_gateway.resources.html import HTML, NOBODY, HtmlWriter, Reader
from linked_fleet_rdf.forms import FormTemplates
from linked_fleet_rdf.graph import Graph, integer
from linked_fleet_rdf.serialise import RDF_TYPES
from linked_fleet_rdf.vocabulary import DCTERMS, LF, PREFIXES, SH, XSD
from linked_fleet_server.exchange import Reply
from linked_fleet_server.message_heads import field_block

# Not those of descriptions, which texts from bodies of requests would displace.
_templates = FormTemplates(max_characters=1024 * 1024)
# RFC 9457 defines no names for these; they are those of the SHACL vocabulary without the word "result"
_REPORTED = {
    SH.focusNode: "focusNode",
    SH.resultPath: "path",
    SH.resultMessage: "message",
    SH.value: "value",
    SH.sourceConstraintComponent: "sourceConstraintComponent",
}


def problem(
    error: FleetError,
    accept: str | None,
    instance: str | None = None,
    html: HtmlWriter | None = None,
    reader: Callable[[], Reader] | None = None,
) -> tuple[bytes, dict[str, str]]:
    """Return body and header fields, including those of the error; ``html`` renders pages, if available.

    ``reader`` returns the reader of a page.
    """
    body, content_type = problem_body(error, accept, instance, html, reader)
    own = {name.lower(): value for name, value in error.headers.items()}
    headers = {"content-type": content_type, "vary": "Accept", "cache-control": "no-store"}
    if html is not None and content_type.startswith(HTML):
        headers |= {
            "content-security-policy": html.content_security_policy(forms=False),
            "content-language": html.language(reader() if reader else NOBODY),
            "vary": "Accept, Accept-Language, Cookie",
            "x-content-type-options": "nosniff",
        }
    return body, headers | own


def rate_refusal(wait_s: int) -> Reply:
    """Return a refusal by rate: JSON whatever the client accepts, so that it costs less than any answer."""
    return Reply(TooManyRequests.status, *_rate_refusal(wait_s))


@lru_cache(maxsize=64)
def _rate_refusal(wait_s: int) -> tuple[bytes, bytes]:
    body, fields = problem(TooManyRequests(wait_s), None)
    lines = [(name.encode(), value.encode()) for name, value in fields.items() if name != "vary"]
    return field_block([*lines, (b"content-length", str(len(body)).encode())]), body


def problem_body(
    error: FleetError,
    accept: str | None,
    instance: str | None = None,
    html: HtmlWriter | None = None,
    reader: Callable[[], Reader] | None = None,
) -> tuple[bytes, str]:
    """Return body and content type. A client that accepts none of the types gets JSON (RFC 9110, 15.5.7)."""
    offered = (PROBLEM_JSON, *RDF_TYPES, *(() if html is None else (HTML,)))
    media_type = choose(accept, offered, equivalent=(PROBLEM_JSON, "application/json")) or PROBLEM_JSON
    if media_type == PROBLEM_JSON:
        return _json(error, instance), PROBLEM_JSON
    if media_type == HTML and html is not None:
        page = html.write_problem(error, instance, _report(error.report) if error.report else [], reader and reader())
        return page, f"{media_type}; charset=utf-8"
    body = _templates.render(_described(error), media_type, PREFIXES, base=instance or "")
    return body, f"{media_type}; charset=utf-8" if media_type.startswith("text/") else media_type


def _json(error: FleetError, instance: str | None) -> bytes:
    members: dict[str, Any] = {
        "type": error.type,
        "title": error.title,
        "status": error.status,
        "detail": error.detail,
    }
    members |= {"instance": instance} if instance else {}
    members |= error.members | error.added
    members |= {"report": _report(error.report)} if error.report else {}
    return json.dumps(members, ensure_ascii=False).encode()


def _report(statements: Sequence[Statement]) -> list[dict[str, str]]:
    """Return the results of a SHACL report in order, as flat objects without blank nodes."""
    results: dict[object, dict[str, str]] = {value: {} for _, predicate, value in statements if predicate == SH.result}
    for subject, predicate, value in statements:
        member = _REPORTED.get(predicate)
        if member and subject in results and not isinstance(value, BlankNode):
            results[subject].setdefault(member, value.value)
    return list(results.values())


def _described(error: FleetError) -> Graph:
    graph, problem = Graph(), BlankNode("problem")
    graph.a(problem, LF.Problem)
    graph.add(problem, DCTERMS.identifier, Literal(error.type, datatype=XSD.anyURI))
    graph.add(problem, LF.status, integer(error.status))
    graph.add(problem, DCTERMS.title, Literal(error.title))
    graph.add(problem, DCTERMS.description, Literal(error.detail))
    graph.extend(error.report or ())
    return graph
