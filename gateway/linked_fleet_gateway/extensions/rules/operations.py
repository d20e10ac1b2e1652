"""Operations of rules in OpenAPI."""

from functools import cache
from itertools import chain

from linked_fleet_gateway.api import RequestView
from linked_fleet_gateway.extensions.openapi.api import (
    CHANGED_RESPONSE,
    ID_SCHEMA,
    JSONLD,
    Json,
    creation_responses,
    header_ref,
    path_item,
    rdf_get_operation,
    resource_path_items,
    write_operation,
)
from linked_fleet_gateway.extensions.rules.request import (
    CONTAINER,
    RULE_SHAPE,
)
from linked_fleet_gateway.extensions.rules.template import LF
from linked_fleet_gateway.faces import form_in
from linked_fleet_rdf.shapes import load_turtle_file
from linked_fleet_rdf.vocabulary import DCTERMS

_CONTEXT = "https://w3id.org/linked-fleet/context"
_MEMBERS = {
    "dcterms:title": DCTERMS.title,
    "lf:condition": LF.condition,
    "lf:minimumInterval": LF.minimumInterval,
    "lf:holdsFor": LF.holdsFor,
    "lf:enabled": LF.enabled,
}


@cache
def _schema() -> Json:
    form = form_in(chain.from_iterable(load_turtle_file(RULE_SHAPE).values()), LF.RuleShape)
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
                "description": "The body of the action; a node with lf:variable stands for the value of that variable."
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
    rule, parameters, fields = f"{CONTAINER}/{{rule}}", {"rule": ID_SCHEMA}, [header_ref("IfMatch")]
    return {
        CONTAINER: path_item(
            {},
            get=rdf_get_operation("readRules", "Rules, with their states"),
            post=write_operation("addRule", "Write a rule", creation_responses("Written."), body),
        ),
        **resource_path_items(
            rule, parameters, "Rule", "A rule, and whether it fires",
            put=write_operation("putRule", "Replace, enable or disable a rule", CHANGED_RESPONSE, body, fields),
            delete=write_operation("deleteRule", "Delete a rule", CHANGED_RESPONSE, None, fields),
        ),
        f"{rule}/firings": path_item(
            parameters, get=rdf_get_operation("readFirings", "Firings of a rule, the newest first")
        ),
    }  # fmt: skip
