"""Subscriptions and their records (paper 5.3, Figure 4); pure values."""

from dataclasses import dataclass, replace
from enum import StrEnum

from linked_fleet_identity.rights import ALL, EVERY, View


class Kind(StrEnum):
    """The channel to the subscriber. STREAM: created by POST and opened, by either protocol, at its own URL."""

    CALLBACK = "callback"
    WEBSOCKET = "websocket"
    EVENT_STREAM = "event-stream"
    STREAM = "stream"

    @property
    def is_stream(self) -> bool:
        """True if messages are sent on a connection that the client opens, which lives no longer than its gateway."""
        return self is not Kind.CALLBACK


class Depth(StrEnum):
    """The extent of a subscription: the statements of the resource, also the values of its properties, or the
    subtree.
    """

    THIS = "this"
    PROPERTIES = "properties"
    SUBTREE = "subtree"


class DeliveryState(StrEnum):
    """The delivery state. WAITING: a stream that nobody has opened. FAILING: the last attempt failed."""

    ACTIVE = "active"
    WAITING = "waiting"
    AWAITING_CONSENT = "awaiting-consent"
    FAILING = "failing"
    SUSPENDED = "suspended"


@dataclass(frozen=True)
class ChangeableOptions:
    """The options of a subscription that can be changed, as described in ``Subscription``."""

    media_type: str
    depth: Depth
    interval_s: float
    deadband: float
    secret: str

    def needs_full_state(self, previous: "ChangeableOptions") -> bool:
        """Return True if changing ``previous`` to these options requires sending the present state of everything
        again.
        """
        return (self.media_type, self.depth) != (previous.media_type, previous.depth)


@dataclass(frozen=True)
class Subscription:
    """A subscription as requested. PATCH changes the options in ``ChangeableOptions`` and nothing else."""

    id: str
    """A UUID."""
    owner: str
    """Path of the thing whose container lists it, such as ``/baxter/right_s1`` or ``/``."""
    resource: str
    """Path of the observed resource, such as ``/baxter/right_s1/rotation``."""
    kind: Kind
    media_type: str
    """The media type of every message (R0.17)."""
    base: str
    """Public URL of the request, without trailing slash; IRIs in messages begin with it."""
    client: str
    """Name or network of the client, by which subscriptions are counted."""
    created_ns: int
    depth: Depth = Depth.PROPERTIES
    interval_s: float = 0.0
    """Least time between two messages in seconds; values in between are conflated."""
    deadband: float = 0.0
    """Deadband in the SI unit of each value: smaller changes since the last message are not sent."""
    callback: str = ""
    """URL of the receiver; callbacks only."""
    secret: str = ""
    """Standard Webhooks secret (``whsec_`` and base64); deliveries are unsigned if empty. Never shown."""
    creator: str = ""
    """Name of the identity that created it; empty if authentication was off."""
    sees: tuple[str, ...] = (EVERY,)
    """Patterns of the robots that its creator may read; messages cover no others."""
    revision: int = 0
    """Number of changes of its options."""

    @property
    def options(self) -> ChangeableOptions:
        return ChangeableOptions(self.media_type, self.depth, self.interval_s, self.deadband, self.secret)

    def with_options(self, options: ChangeableOptions, revision: int) -> "Subscription":
        """Return the subscription with the options after ``revision`` changes."""
        return replace(
            self,
            media_type=options.media_type,
            depth=options.depth,
            interval_s=options.interval_s,
            deadband=options.deadband,
            secret=options.secret,
            revision=revision,
        )

    @property
    def view(self) -> View:
        return ALL if EVERY in self.sees else View.of(frozenset(self.sees), self.creator)


@dataclass(frozen=True)
class Delivery:
    """The state of deliveries; times in wall nanoseconds."""

    state: DeliveryState = DeliveryState.ACTIVE
    last_ns: int | None = None
    """Time of the last sent message (streams) or of the end of the last attempt (callbacks)."""
    last_status: int | None = None
    """HTTP status of the last attempt; None without a response."""
    failures: int = 0
    """Number of failed attempts in a row."""
    reason: str = ""
    """A sentence that explains a failure, a suspension or a missing consent."""
    consented: bool = False
    """True if the receiver has agreed to deliveries (CloudEvents webhook handshake)."""
    allowed_interval_s: float = 0.0
    """Least time between deliveries in seconds, as granted by the receiver."""


@dataclass(frozen=True)
class Record:
    """A subscription as stored. ``holder`` is the run of the gateway that serves it."""

    subscription: Subscription
    delivery: Delivery
    holder: str

    @property
    def is_durable(self) -> bool:
        """True if it survives its gateway: callbacks, and streams that wait to be opened."""
        return not self.subscription.kind.is_stream or self.delivery.state is DeliveryState.WAITING
