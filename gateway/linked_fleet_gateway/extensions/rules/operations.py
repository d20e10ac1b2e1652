"""Operations on rules, for descriptions of the whole gateway.

Bodies are JSON-LD, because a rule may give its action any RDF.
"""

from functools import cache
from itertools import chain

from linked_fleet_gateway.extensions.rules.request import CONTAINER, RULE_SHAPE
from linked_fleet_gateway.extensions.rules.terms import LF
from linked_fleet_gateway.http.operations import (
    CHANGED,
    ID,
    JSONLD,
    created,
    described,
    header,
    path_item,
    reading,
    writing,
)
from linked_fleet_gateway.rdf.shapes import load_file
from linked_fleet_gateway.rdf.vocabulary import DCTERMS
from linked_fleet_gateway.resources.branches import RequestView
from linked_fleet_gateway.resources.json_form import Json, form_in

_CONTEXT = "https://w3id.org/linked-fleet/context"
_MEMBERS = {
    "dcterms:title": DCTERMS.title,
    "lf:condition": LF.condition,
    "lf:minimumInterval": LF.minimumInterval,
    "lf:enabled": LF.enabled,
}


@cache
def _schema() -> Json:
    form = form_in(chain.from_iterable(load_file(RULE_SHAPE).values()), LF.RuleShape)
    of_path = {each.path: each.schema() for each in form.fields}  # the shape names them for people
    action: Json = {"type": "object", "properties": {"@id": {"type": "string", "format": "uri"}}, "required": ["@id"]}
    return {
        "type": "object",
        "properties": {
            "@context": {"const": _CONTEXT},
            "@type": {"const": "lf:Rule"},
            **{member: of_path[predicate,] for member, predicate in _MEMBERS.items()},
            "lf:invokes": action | {"description": "The action."},
            "lf:body": {
                "description": "What the action gets; a node with lf:variable stands for what that is bound to."
            },
        },
        "required": ["@context", "dcterms:title", "lf:condition", "lf:invokes"],
    }


def operations(view: RequestView) -> dict[str, Json]:
    """Return the path items of rules, which are written, replaced and deleted, and of their firings."""
    example = {
        "@context": _CONTEXT,
        "@type": "lf:Rule",
        "dcterms:title": "Stop all robots when one is faulty",
        "lf:condition": f"SELECT ?robot {{ ?robot <{LF.presence.value}> <{LF.faulty.value}> }}",
        "lf:invokes": {"@id": view.base + "/actions/stopAll"},
        "lf:enabled": False,
    }
    body: Json = {JSONLD: {"schema": _schema(), "examples": {"stop all": {"value": example}}}}
    rule, parameters, fields = f"{CONTAINER}/{{rule}}", {"rule": ID}, [header("IfMatch")]
    return {
        CONTAINER: path_item(
            {},
            get=reading("readRules", "Rules, with their states"),
            post=writing("addRule", "Write a rule", created("Written."), body),
        ),
        **described(
            rule, parameters, "Rule", "A rule, and whether it fires",
            put=writing("putRule", "Replace, enable or disable a rule", CHANGED, body, fields),
            delete=writing("deleteRule", "Delete a rule", CHANGED, None, fields),
        ),
        f"{rule}/firings": path_item(parameters, get=reading("readFirings", "Firings of a rule, the newest first")),
    }  # fmt: skip
