"""Views of actions, invocations, subscriptions and leases, beside the facts that every page shows."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from pyoxigraph import BlankNode, NamedNode

from linked_fleet_base.lazy_imports import LazyModule
from linked_fleet_gateway.extensions.pages import texts
from linked_fleet_gateway.extensions.pages.languages import known, say
from linked_fleet_gateway.extensions.pages.moments import timeline_link
from linked_fleet_gateway.extensions.pages.thing_views import actions, unchecked_links
from linked_fleet_gateway.extensions.pages.values import Facts, Link, Number, State, Value
from linked_fleet_gateway.extensions.pages.views import Part
from linked_fleet_rdf.turtle import Subject, Term
from linked_fleet_rdf.vocabulary import DCTERMS, HTTP, HYBRIT, LDP, LF, PROV, RDFS

if TYPE_CHECKING:
    from linked_fleet_gateway.extensions.pages import form
else:
    form = LazyModule("linked_fleet_gateway.extensions.pages.form")

_PREDICATES_OF_SUBSCRIPTION = (LF.deliveryState, LF.lastDelivery, LF.failures, LF.reason)


def action(facts: Facts, iri: NamedNode) -> Part:
    more = {
        "comment": texts.sentence(facts.text(iri, RDFS.comment)),
        "form": form.form_of_action(facts, iri),
        "invocations": facts.iri_of(iri, LF.invocations),
    }
    # Both requests of a binding share one body node, which has no facts to show, and the form shows the shape.
    bodies = {each for each in facts.all(iri, HYBRIT.binding, HTTP.body) if isinstance(each, BlankNode)}
    shown = {RDFS.comment, HYBRIT.consumes, HYBRIT.binding, LF.invocations}
    kind, colon, part = facts.text(iri, DCTERMS.title).partition(": ")
    return Part(more, shown, bodies | _shape(facts, iri), known(kind) + colon + part)


def _shape(facts: Facts, iri: NamedNode) -> set[Subject]:
    """Return the blank nodes of the shape of what an action takes."""
    found, pending = set[Subject](), facts.all(iri, HYBRIT.consumes)
    while pending:
        node = pending.pop()
        if isinstance(node, BlankNode) and node not in found:
            found.add(node)
            pending += [each for values in facts.of.get(node, {}).values() for each in values]
    return found


# -- invocation -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class JointTarget:
    """A joint with its target and its resulting position."""

    joint: Link
    target: Number | None
    result: Number | None


def invocation(facts: Facts, iri: NamedNode) -> Part:
    said = {
        name: _only(facts, iri, predicate)
        for name, predicate in (("state", LF.state), ("progress", LF.progress), ("reason", LF.reason))
    }
    targets, results = (_positions(facts, iri, predicate) for predicate in (LF.target, LF.result))
    joints = dict.fromkeys((*targets, *results))
    begin = facts.text(iri, PROV.startedAtTime) or facts.text(iri, DCTERMS.created)
    more = {
        **said,
        "about": texts.thing(iri.value, facts.root),
        "input": facts.values(iri, LF.input),
        "joints": [JointTarget(facts.link(each), targets.get(each), results.get(each)) for each in joints],
        "actions": actions(facts, iri),
        "open": facts.one(iri, HYBRIT.action) is not None,
        "unchecked": unchecked_links(facts, iri),
        "timeline": timeline_link(facts, begin, facts.text(iri, PROV.endedAtTime)),
    }
    shown = {LF.unchecked, LF.state, LF.progress, LF.reason, LF.input, LF.target, LF.result, HYBRIT.action}
    return Part(more, shown, title=_motion(facts, iri) if "/invocations/" in iri.value else "")


def _positions(facts: Facts, iri: NamedNode, predicate: NamedNode) -> dict[NamedNode, Number]:
    return {
        joint: facts.scalar(value, None)
        for node in facts.all(iri, predicate)
        if isinstance(joint := facts.one(node, LF.ofJoint), NamedNode)
        and (value := facts.one(node, LF.value)) is not None
    }


@dataclass(frozen=True)
class InvocationRow:
    """An invocation in its container's list."""

    link: Link
    state: Value | None
    reason: str
    when: Value | None
    who: str


def invocations(facts: Facts, iri: NamedNode) -> Part:
    members = facts.nodes(iri, LDP.contains)
    listed = [_done(facts, each) for each in members]
    states = sorted({each.state.name for each in listed if isinstance(each.state, State)})
    people = sorted({each.who for each in listed if each.who})
    more = {"listed": listed, "choices": [("state-name", say("State"), states), ("who", say("Who"), people)]}
    title = say("Invocations of {action}", action=texts.task(iri.value, facts.root))
    return Part(more, {LDP.contains}, set(members), title)


def _done(facts: Facts, iri: NamedNode) -> InvocationRow:
    agent = facts.one(iri, PROV.wasAssociatedWith)
    return InvocationRow(
        Link(_motion(facts, iri), iri.value, iri.value),
        _only(facts, iri, LF.state),
        texts.sentence(facts.text(iri, LF.reason)),
        _only(facts, iri, DCTERMS.created),
        facts.text(agent, DCTERMS.title) if agent is not None else "",
    )


def _motion(facts: Facts, iri: NamedNode) -> str:
    """Describe an invocation in words, with its targets if there are any."""
    targets = {
        texts.place(joint.value, facts.root): (float(number.value), number.name)
        for joint, number in _positions(facts, iri, LF.target).items()
        if number.value
    }
    return texts.motion(iri.value, facts.root, targets)


def _only(facts: Facts, iri: Term, predicate: NamedNode) -> Value | None:
    found = facts.values(iri, predicate) if isinstance(iri, NamedNode) else []
    return found[0] if found else None


# -- subscriptions --------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SubscriptionRow:
    """A subscription as shown on a page: its receiver, its resource, and the state of its delivery."""

    link: Link
    type: str
    receiver: str
    resource: Link
    state: Value | None
    delivery: Value | None
    failures: Value | None
    reason: Value | None


def is_subscriptions(facts: Facts, iri: NamedNode) -> bool:
    return LF.SubscriptionShape in facts.all(iri, LDP.constrainedBy)


def subscriptions(facts: Facts, iri: NamedNode) -> Part:
    members = facts.nodes(iri, LDP.contains)
    more = {
        "watches": [_watch(facts, each) for each in members if each in facts.of],
        "unlisted": [facts.link(each) for each in members if each not in facts.of],
        "form": form.form_of_subscription(iri.value, facts.iri_of(iri, RDFS.seeAlso)),
    }
    return Part(more, {LDP.contains, LDP.constrainedBy, LF.vocabulary}, set(members))


def _watch(facts: Facts, iri: NamedNode) -> SubscriptionRow:
    types = [each for each in facts.types(iri) if each.iri not in (HYBRIT.Subscription.value, LF.Stream.value)]
    link = Link(facts.text(iri, DCTERMS.identifier)[:8], iri.value, iri.value)
    state, delivery, failures, reason = (_only(facts, iri, each) for each in _PREDICATES_OF_SUBSCRIPTION)
    receiver = facts.text(iri, HYBRIT.callbackURL)
    watched = facts.iri_of(iri, HYBRIT.onResource)
    resource = Link(texts.thing(watched, facts.root), watched, watched)
    return SubscriptionRow(
        link, types[0].text if types else say("stream"), receiver, resource, state, delivery, failures, reason
    )


def subscription(facts: Facts, iri: NamedNode) -> Part:
    more = {"state": _only(facts, iri, LF.deliveryState), "actions": actions(facts, iri)}
    return Part(more, {HYBRIT.action, LF.deliveryState})


def lease(facts: Facts, iri: NamedNode) -> Part:
    return Part({"state": _only(facts, iri, LF.state)}, {LF.state, HYBRIT.consumes})
