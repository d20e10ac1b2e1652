"""The part of the tree below the actions of a thing: actions, shapes of their results, and invocations."""

import json
from collections.abc import Iterator, Sequence
from functools import partial

from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.resources.access_filter import InvocationsInView
from linked_fleet_gateway.resources.action_offer import Offer
from linked_fleet_gateway.resources.affordance import EndInvocation, Invoke
from linked_fleet_gateway.resources.description import Describe, DescriptionTemplate, InSteps
from linked_fleet_gateway.resources.invocation import (
    OUTPUT,
    cancel_path,
    describe_cancel,
    describe_invocation,
    describe_invocations,
    invocation_path,
)
from linked_fleet_gateway.resources.part import part_of
from linked_fleet_gateway.resources.plain_json import add_plain_json, stored_json
from linked_fleet_gateway.resources.resource import CONTAINER, Resource, blueprint_of
from linked_fleet_gateway.resources.versioning import Source
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.serialise import JSON
from linked_fleet_rdf.vocabulary import LF
from linked_fleet_state.invocations import Invocation
from linked_fleet_state.robot import Robot

_MOST_WRITTEN = 1024
"""Bytes of feedback and result that are written at once; a thread writes the description of more."""


def resolve_action(
    offers: Sequence[Offer], rest: Sequence[str], invocations: InvocationsInView, source: Source, base: str
) -> Resource | None:
    """Return the resource at ``rest`` below ``actions/`` of a thing; ``offers``: the action at ``rest[0]``, if any."""
    if not offers:
        return None
    (offer,) = offers
    if rest[1:] == []:
        return _action(offer, source, base)
    if rest[1:] == ["produceshape"]:
        return _result(offer, source, base)
    if rest[1] != "invocations":
        return None
    if rest[2:] == []:
        return _invocations(offer, invocations, base)
    invocation = invocations.get(rest[2])
    if invocation is None or invocation.action != offer.path:
        return None
    return _in_invocation(invocation_of(offer.robot, invocation, invocations, base), invocation, rest[3:], base)


def invocation_of(robot: Robot | None, invocation: Invocation, invocations: InvocationsInView, base: str) -> Resource:
    def describe(graph: Graph) -> None:
        ids = (*invocation.preempts, invocation.preempted_by)
        others = {id: other for id in ids if (other := invocations.get(id)) is not None}
        answers, unchecked = invocations.answers(invocation), invocations.unchecked(invocation)
        describe_invocation(graph, base, robot, invocation, others, answers, unchecked)

    def steps(graph: Graph) -> Iterator[None]:
        describe(graph)
        yield

    path = invocation_path(invocation)
    is_long = len(invocation.outcome) + len(invocation.feedback) + len(invocation.output) > _MOST_WRITTEN
    resource = Resource(
        path,
        f"Invocation {invocation.id}",
        InSteps(steps) if is_long else describe,
        source=Source(lambda: _facts(invocation), is_final=lambda: invocation.is_final),
        own_paths=(path + "/blueprint", *(() if invocation.state.terminal else (cancel_path(invocation),))),
        affords=EndInvocation(invocation, keep_record=False),
    )
    resource = add_plain_json(resource, LF.InvocationShape, base)
    part = None if robot is None else part_of(robot, invocation)
    if not (invocation.outcome or invocation.feedback or invocation.stream):
        part = None
    if part is None and not invocation.output:
        return resource
    write = resource.documents[JSON]

    def with_outcome() -> bytes:
        told = json.loads(write())
        if invocation.output:
            told["output"] = stored_json(invocation.output, OUTPUT)
        if part is not None:
            told |= part.outcome_json(invocation)
        return json.dumps(told, ensure_ascii=False).encode()

    return resource.replace(documents={**resource.documents, JSON: with_outcome})


def _facts(invocation: Invocation) -> tuple[object, ...]:
    return (
        invocation.state.value,
        invocation.reason,
        round(invocation.progress, 3),
        invocation.duration_s,
        list(invocation.result.items()),
        invocation.preempts,
        invocation.preempted_by,
        list(invocation.robots.items()),
        invocation.unchecked,
        invocation.feedback,
        invocation.outcome,
        invocation.output,
        invocation.stream,
    )


def _action(offer: Offer, source: Source, base: str) -> Resource:
    own = (offer.path + "/produceshape", offer.path + "/invocations")
    # Neither an LDP resource nor a container: PUT does not replace state, POST does not create a member.
    return Resource(
        offer.path,
        offer.name,
        _description(offer, base),
        (),
        source,
        own,
        affords=Invoke(offer),
    )


def _description(offer: Offer, base: str) -> Describe:
    if (key := offer.template_key) is None:
        return partial(offer.describe, base=base)
    return DescriptionTemplate(
        key,
        offer.thing,
        lambda graph, thing, values: offer.describe_at(graph, base, thing, values),
        lambda: offer.values,
    )


def _kind_of(offer: Offer) -> tuple[NamedNode, str, str]:
    """Return what offers have in common that differ in their things alone."""
    return offer.definition.iri, offer.definition.segment, offer.declared_by


def _result(offer: Offer, source: Source, base: str) -> Resource:
    title = offer.result_title()

    def describe(graph: Graph, thing: str, values: Sequence[Literal]) -> None:
        offer.describe_result(graph, base, thing, *values)

    return Resource(
        offer.path + "/produceshape",
        f"Shape of what {offer.name} produces",
        DescriptionTemplate((*_kind_of(offer), "result"), offer.thing, describe, lambda: (title,)),
        source=source,
    )


def _invocations(offer: Offer, invocations: InvocationsInView, base: str) -> Resource:
    members = invocations.of_action(offer.path)

    def describe(graph: Graph, thing: str = offer.thing, _: object = ()) -> None:
        describe_invocations(graph, base, offer.path_at(thing), offer.robot, members)

    alike = DescriptionTemplate((*_kind_of(offer), "no invocations"), offer.thing, describe)
    return Resource(
        offer.path + "/invocations",
        f"Invocations of {offer.name}",
        describe if members else alike,
        CONTAINER,
        Source(lambda: [(each.id, each.state.value, each.reason) for each in invocations.of_action(offer.path)]),
        own_paths=tuple(invocation_path(each) for each in members),
    )


def _in_invocation(whole: Resource, invocation: Invocation, rest: Sequence[str], base: str) -> Resource | None:
    if not rest:
        return whole
    if list(rest) == ["blueprint"]:
        return blueprint_of(whole, base, (LF.InvocationShape,))
    if list(rest) == ["actions", "cancel"] and not invocation.state.terminal:
        path, cancelling = cancel_path(invocation), EndInvocation(invocation, keep_record=True)
        title = f"Cancel invocation {invocation.id}"
        return Resource(
            path, title, lambda graph: describe_cancel(graph, base, invocation), (), whole.source, affords=cancelling
        )
    return None
