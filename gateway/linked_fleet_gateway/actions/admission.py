"""Validation of a body by the shape that its action's description links, compiled once (paper 5.4)."""

import re
from collections.abc import Sequence

from pyoxigraph import NamedNode, Triple

from linked_fleet_base.errors import UnprocessableContent
from linked_fleet_gateway.resources.action_offer import Offer
from linked_fleet_gateway.resources.annotations import named_poses
from linked_fleet_gateway.resources.body_values import Body, own_statements
from linked_fleet_rdf.graph import Graph, Node
from linked_fleet_rdf.validation import (
    ShaclValidator,
    Terms,
    check_writable,
    find_root,
    refuse_statements,
    statements_by_subject,
    unused_statements,
)
from linked_fleet_rdf.vocabulary import HYBRIT, LF, MATHS, QUDT, RDF, ROS, SPATIAL, VOM
from linked_fleet_state.robot_cache import RobotCache

_OWN = (HYBRIT, LF, MATHS, QUDT, ROS, SPATIAL, VOM)
"""The vocabularies of actions."""
_KNOWN = frozenset(term for each in _OWN for term in each.terms.values())

_VALIDATORS = RobotCache[tuple[ShaclValidator, Terms]]()


def validate_action_body(offer: Offer, triples: Sequence[Triple], base: str) -> Body:
    """Validate a body and return its typed form.

    Raises UnprocessableContent with the validation report if the shape refuses it, or naming statements in our own
    vocabularies, or about other resources, that have no effect. Statements in other vocabularies are outside the shape
    (paper 5.4); they are stored with the invocation.
    """
    if (declared := offer.read_body(triples, base)) is not None:
        body: Body = declared
        return body
    iri = base + offer.path
    focus = find_root(triples, NamedNode(iri))
    robot = offer.robot
    model = robot.model if robot is not None else None
    named = tuple(named_poses(robot)) if robot is not None and offer.definition.iri == LF.AssumePose else ()
    joints = () if robot is None else robot.commanded
    key = offer.definition, base, offer.thing, named
    validator, terms = _VALIDATORS.get(robot, (model, joints), key, lambda: _validator(offer, base))
    report = validator.report(triples, focus)
    if report is not None:
        detail, about = report
        raise UnprocessableContent(
            f"The body does not conform to the shape of the action: {detail}", report=about, constraint=iri
        )
    left = unused_statements(triples, focus, terms)
    refuse_statements(_not_kept(left, triples, focus, terms), iri)
    check_writable(left, iri)
    return Body(triples, focus)


def _not_kept(left: list[Triple], triples: Sequence[Triple], focus: Node, terms: Terms) -> list[Triple]:
    """Return the statements to refuse, which are neither used nor stored: a misspelt speed must not mean full speed."""
    if not left:
        return left
    kept, ours = set(own_statements(triples, focus)), _namespaces(terms)
    return [each for each in left if each not in kept or _is_ours(each, ours)]


def _is_ours(triple: Triple, ours: tuple[str, ...]) -> bool:
    """Return True for a predicate of our vocabularies, with either scheme, or for a type that they do not have."""
    if triple.predicate != RDF.type:
        return _bare(triple.predicate.value).startswith(ours)
    value = triple.object
    return isinstance(value, NamedNode) and _bare(value.value).startswith(ours) and value not in _KNOWN


def _namespaces(terms: Terms) -> tuple[str, ...]:
    """Return the namespaces of the gateway's actions and of the predicates in the shape."""
    pending, found = [terms], {_bare(each.iri) for each in _OWN}
    while pending:
        inner = pending.pop().inner
        pending += inner.values()
        found |= {_bare(re.sub(r"[^#/]*$", "", predicate.value)) for predicate in inner}
    return tuple(found)


def _bare(iri: str) -> str:
    return iri.partition("://")[2]


def _validator(offer: Offer, base: str) -> tuple[ShaclValidator, Terms]:
    """Return the compiled shape of a body."""
    graph = Graph()
    shape = offer.describe_input(graph, base)
    return ShaclValidator(graph.triples, shape), Terms.from_shapes(statements_by_subject(graph.triples), shape)
