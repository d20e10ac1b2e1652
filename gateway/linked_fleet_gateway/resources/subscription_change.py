"""Changes of a subscription: its updated description, validated by the shapes of its container."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

from pyoxigraph import NamedNode, Triple

from linked_fleet_base.errors import UnprocessableContent
from linked_fleet_gateway.resources.subscription import ChangeableOptions, Subscription
from linked_fleet_gateway.resources.subscription_resource import (
    CALLBACKS,
    container_path,
    read_request,
    subscription_path,
)
from linked_fleet_rdf.shapes import SUBSCRIPTIONS, load_turtle
from linked_fleet_rdf.validation import Terms, refuse_statements, unused_statements
from linked_fleet_rdf.vocabulary import HYBRIT, LF, RDF

_FIXED = (RDF.type, HYBRIT.onResource, *CALLBACKS)
"""Predicates that identify the subscription."""


def managed_option_statements(description: Sequence[Triple], iri: str) -> list[Triple]:
    """Return the statements of a description that only the gateway makes."""
    return [each for each in unused_statements(description, NamedNode(iri), _terms()) if each.predicate not in _FIXED]


def changed_options(
    before: Sequence[Triple], after: Sequence[Triple], subscription: Subscription, base: str
) -> ChangeableOptions:
    """Return the options in a description ``after`` an update.

    A removed option gets its default; ``media_type`` is then empty. A secret that is not mentioned is kept. Raises
    UnprocessableContent, with the report, if the shapes refuse the description.
    """
    container, iri = base + container_path(subscription.owner), NamedNode(base + subscription_path(subscription))
    _check_fixed(before, after, iri, subscription, container)
    refuse_statements(unused_statements(after, iri, _terms(), frozenset(before)), f"{iri.value}/blueprint")
    wanted, kept = read_request(after, container, base), subscription.options

    def touched(predicate: NamedNode) -> bool:
        return _stated(before, iri, (predicate,)) != _stated(after, iri, (predicate,))

    # Unchanged options are not read back from the description, whose numbers may be rounded.
    return replace(
        kept,
        media_type=wanted.media_type if touched(HYBRIT.mediaType) else kept.media_type,
        depth=wanted.depth if touched(LF.depth) else kept.depth,
        interval_s=wanted.interval_s if touched(LF.minimumInterval) else kept.interval_s,
        deadband=wanted.deadband if touched(LF.deadband) else kept.deadband,
        secret=wanted.secret or kept.secret,
    )


def _check_fixed(
    before: Sequence[Triple], after: Sequence[Triple], iri: NamedNode, subscription: Subscription, container: str
) -> None:
    """Raise UnprocessableContent, naming the predicates, if the update changes the identity of the subscription."""
    fixed = _FIXED if not subscription.kind.is_stream else (*_FIXED, HYBRIT.mediaType)
    differs = _stated(before, iri, fixed) ^ _stated(after, iri, fixed)
    if differs:
        named = ", ".join(sorted({f"<{each.predicate.value}>" for each in differs}))
        why = " A stream has one media type, by which it is opened." if subscription.kind.is_stream else ""
        raise UnprocessableContent(
            f"{named} of a subscription cannot be changed; make another one, and delete this one.{why}"
            " Nothing has changed.",
            constraint=container,
        )


def _stated(triples: Sequence[Triple], iri: NamedNode, predicates: Sequence[NamedNode]) -> set[Triple]:
    return {triple for triple in triples if triple.subject == iri and triple.predicate in predicates}


@cache
def _terms() -> Terms:
    return Terms.from_shapes(load_turtle(SUBSCRIPTIONS), LF.SubscriptionShape)
