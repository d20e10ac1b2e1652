"""Subscriptions and their records (paper 5.3, Figure 4); pure values."""

from dataclasses import dataclass, replace
from enum import StrEnum

from linked_fleet_gateway.identity.rights import ALL, EVERY, View, view


class Kind(StrEnum):
    """How messages reach the subscriber. STREAM: made by POST and opened, by either protocol, at its own address."""

    CALLBACK = "callback"
    WEBSOCKET = "websocket"
    EVENT_STREAM = "event-stream"
    STREAM = "stream"

    @property
    def streams(self) -> bool:
        """True if its messages leave on a connection that the client opens; that lives no longer than its gateway."""
        return self is not Kind.CALLBACK


class Depth(StrEnum):
    """The extent of a subscription: the resource's own statements, the values of its properties too, or all below."""

    THIS = "this"
    PROPERTIES = "properties"
    SUBTREE = "subtree"


class DeliveryState(StrEnum):
    """WAITING: a stream that nobody has opened. FAILING: the receiver did not take the last attempt."""

    ACTIVE = "active"
    WAITING = "waiting"
    AWAITING_CONSENT = "awaiting-consent"
    FAILING = "failing"
    SUSPENDED = "suspended"


@dataclass(frozen=True)
class Changeable:
    """The options of a subscription that may be changed while it lasts; their meaning is that in ``Subscription``."""

    media_type: str
    depth: Depth
    interval_s: float
    deadband: float
    secret: str

    def begins_anew(self, before: "Changeable") -> bool:
        """Return True if these options in place of ``before`` call for the present state of everything once more."""
        return (self.media_type, self.depth) != (before.media_type, before.depth)


@dataclass(frozen=True)
class Subscription:
    """The request of the client. ``Changeable`` has the options that PATCH changes; nothing else ever does."""

    id: str
    """A UUID."""
    owner: str
    """Path of the thing whose container lists it, such as ``/baxter/right_s1`` or ``/``."""
    resource: str
    """Path of what is observed, such as ``/baxter/right_s1/rotation``."""
    kind: Kind
    media_type: str
    """The media type of every message (R0.17)."""
    base: str
    """Public URL under which the client asked, without slash; the IRIs in messages begin with it."""
    client: str
    """Name or network address of who asked; its subscriptions are counted."""
    created_ns: int
    depth: Depth = Depth.PROPERTIES
    interval_s: float = 0.0
    """The least time between two messages; values are conflated in between."""
    deadband: float = 0.0
    """In the SI unit of each value: it is no news until it has moved that far from what was last sent."""
    callback: str = ""
    """URL of the receiver; only a callback has one."""
    secret: str = ""
    """Standard Webhooks secret (``whsec_`` and base64); empty: deliveries are not signed. Never shown."""
    creator: str = ""
    """Name of the identity that asked for it; empty where none were configured."""
    sees: tuple[str, ...] = (EVERY,)
    """Patterns of the robots that its creator may read: messages tell of no others."""
    revision: int = 0
    """The number of times that its options have been changed."""

    @property
    def options(self) -> Changeable:
        return Changeable(self.media_type, self.depth, self.interval_s, self.deadband, self.secret)

    def having(self, options: Changeable, revision: int) -> "Subscription":
        """The same subscription with the options that it has after ``revision`` changes."""
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
        return ALL if EVERY in self.sees else view(frozenset(self.sees), self.creator)


@dataclass(frozen=True)
class Delivery:
    """The deliveries so far; times in wall nanoseconds."""

    state: DeliveryState = DeliveryState.ACTIVE
    last_ns: int | None = None
    """When the last message was sent (streams) or the last attempt of a delivery ended (callbacks)."""
    last_status: int | None = None
    """HTTP status of the last attempt; None without an answer."""
    failures: int = 0
    """Failed attempts in a row."""
    reason: str = ""
    """Why it is failing, suspended or without consent, as a sentence."""
    consented: bool = False
    """True if the receiver has agreed to deliveries (CloudEvents webhook handshake)."""
    allowed_interval_s: float = 0.0
    """The least time between deliveries that the receiver asked for with its consent."""


@dataclass(frozen=True)
class Record:
    """A subscription as the store has it. ``holder`` is the run of the gateway that serves it."""

    subscription: Subscription
    delivery: Delivery
    holder: str

    @property
    def lasts(self) -> bool:
        """True if it outlives its gateway: a callback does, and a stream that waits to be opened."""
        return not self.subscription.kind.streams or self.delivery.state is DeliveryState.WAITING
