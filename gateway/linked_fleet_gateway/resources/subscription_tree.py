"""The part of the tree below a Subscriptions container (R1.8)."""

from collections.abc import Sequence

from linked_fleet_gateway.rdf.vocabulary import LF
from linked_fleet_gateway.resources.affordance import ChangeSubscription, ResumeSubscription, Subscribe
from linked_fleet_gateway.resources.resource import CONTAINER, Resource, blueprint_of
from linked_fleet_gateway.resources.subscription import Record
from linked_fleet_gateway.resources.subscription_resource import (
    container_path,
    describe_resume,
    describe_subscription,
    describe_subscriptions,
    resumable,
    resume_path,
    subscription_path,
)


def in_subscriptions(thing: Resource, rest: list[str], records: Sequence[Record], base: str) -> Resource | None:
    """Return the container of ``thing``, a subscription in it, or its action; ``records`` are the visible ones."""
    if not rest:
        return Resource(
            container_path(thing.path),
            f"Subscriptions of {thing.title}",
            lambda graph: describe_subscriptions(graph, base, thing.path, records),
            CONTAINER,
            own=tuple(subscription_path(each.subscription) for each in records),
            affords=Subscribe(thing.path),
        )
    record = next((each for each in records if each.subscription.id == rest[0]), None)
    if record is None:
        return None
    path, resume = subscription_path(record.subscription), resume_path(record.subscription)
    title = f"Subscription {record.subscription.id}"
    if rest[1:] == ["actions", "resume"] and resumable(record):
        return Resource(
            resume,
            f"Resume {title}",
            lambda graph: describe_resume(graph, base, record),
            (),
            affords=ResumeSubscription(record),
        )
    whole = Resource(
        path,
        title,
        lambda graph: describe_subscription(graph, base, record),
        own=(path + "/blueprint", *((resume,) if resumable(record) else ())),
        affords=ChangeSubscription(record),
    )
    if rest[1:] == ["blueprint"]:
        return blueprint_of(whole, base, (LF.SubscriptionResourceShape,))
    return None if rest[1:] else whole
