"""Records in the store besides subscriptions, and their form as fields of a Redis hash."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, cast

import msgspec

from linked_fleet_gateway.resources.subscription import Changeable, Delivery, DeliveryState, Record, Subscription

What = Literal["removed", "woken", "replaced", "changed"]


@dataclass(frozen=True)
class Outgoing:
    """A representation to be delivered, rendered for the ``revision`` of its subscription."""

    path: str
    version: str
    media_type: str
    body: bytes
    revision: int = 0


@dataclass(frozen=True)
class Entry:
    """A representation in the queue of a callback. ``number`` counts its deliveries from 1 without gaps."""

    entry_id: str
    number: int
    path: str
    version: str
    media_type: str
    body: bytes


@dataclass(frozen=True)
class Backlog:
    """The undelivered entries, oldest first, with the state of the queue.

    ``sent``: the version of each resource that was queued last, by path. ``number``: that of the last entry, delivered
    or not.
    """

    entries: list[Entry]
    sent: dict[str, str]
    number: int = 0


@dataclass(frozen=True)
class News:
    """A change by another gateway to a subscription of the run ``holder``.

    ``changed``: it has other options. This concerns every run: one that does not hold it yet may be about to open it.
    ``replaced``: a stream is open there now, unless ``holder`` has taken it back since; its record says who has it.
    """

    what: What
    id: str
    holder: str


@dataclass(frozen=True)
class Held:
    """The lists that contain a subscription. The run that holds it writes this before anything else."""

    owner: str
    client: str


def write_held(held: Held) -> bytes:
    return msgspec.json.encode(held)


def read_held(text: bytes) -> Held:
    """Parse the output of ``write_held``. Raises ValueError for anything else."""
    return msgspec.json.decode(text, type=Held)


def write_news(news: News) -> tuple[str, ...]:
    return ("what", news.what, "id", news.id, "holder", news.holder)


def read_news(fields: Mapping[bytes, bytes]) -> News:
    what = cast(What, fields[b"what"].decode())
    return News(what, fields[b"id"].decode(), fields[b"holder"].decode())


def write_spec(subscription: Subscription) -> tuple[str | bytes, ...]:
    """Return the fields of the client's request.

    Changed options have fields of their own, so that no run overwrites them with what it knew.
    """
    return ("spec", msgspec.json.encode(replace(subscription, revision=0)))


def write_options(options: Changeable) -> bytes:
    return msgspec.json.encode(options)


def write_delivery(delivery: Delivery) -> tuple[str, ...]:
    """Return names and values in turn; None becomes empty."""
    return (
        *("state", delivery.state.value),
        *("last_ns", "" if delivery.last_ns is None else str(delivery.last_ns)),
        *("last_status", "" if delivery.last_status is None else str(delivery.last_status)),
        *("failures", str(delivery.failures)),
        *("reason", delivery.reason),
        *("consented", "1" if delivery.consented else ""),
        *("allowed_interval_s", repr(delivery.allowed_interval_s)),
    )


def read_record(fields: Mapping[bytes, bytes]) -> Record | None:
    """Return None for no fields; raises ValueError or KeyError for fields that this version does not write."""
    if not fields:
        return None
    subscription = msgspec.json.decode(fields[b"spec"], type=Subscription)
    if (options := fields.get(b"options")) is not None:
        subscription = subscription.having(msgspec.json.decode(options, type=Changeable), int(fields[b"revision"]))
    delivery = Delivery(
        state=DeliveryState(fields[b"state"].decode()),
        last_ns=_number(fields[b"last_ns"]),
        last_status=_number(fields[b"last_status"]),
        failures=int(fields[b"failures"]),
        reason=fields[b"reason"].decode(),
        consented=bool(fields[b"consented"]),
        allowed_interval_s=float(fields[b"allowed_interval_s"]),
    )
    return Record(subscription, delivery, fields[b"holder"].decode())


def read_entry(entry_id: bytes, pairs: list[bytes]) -> Entry:
    fields = read_pairs(pairs)
    return Entry(
        entry_id.decode(),
        int(fields[b"number"]),
        fields[b"path"].decode(),
        fields[b"version"].decode(),
        fields[b"media_type"].decode(),
        fields[b"body"],
    )


def read_pairs(pairs: list[bytes]) -> dict[bytes, bytes]:
    """Return a hash from the names and values in turn that scripts return."""
    return dict(zip(pairs[::2], pairs[1::2], strict=True))


def _number(text: bytes) -> int | None:
    return int(text) if text else None
