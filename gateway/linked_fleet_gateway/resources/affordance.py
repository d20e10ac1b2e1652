"""Affordances: the methods of a resource other than reading. Requests are dispatched by their type.

``needs`` lists rights, one of which suffices.
"""

from dataclasses import dataclass
from enum import Enum
from typing import ClassVar, Final, Protocol

from linked_fleet_gateway.resources.action_offer import Offer
from linked_fleet_gateway.resources.body_values import Setting
from linked_fleet_gateway.resources.subscription import Record
from linked_fleet_identity.rights import Right
from linked_fleet_rdf.serialise import JSON, TEXT_TYPES
from linked_fleet_state.invocations import Invocation
from linked_fleet_state.robot import Robot

BODY_TYPES = TEXT_TYPES
"""RDF media types of bodies. Jelly is excluded, because its parser raises arbitrary exceptions on untrusted bytes."""
FORM_TYPES = (*BODY_TYPES, JSON)
"""Media types of bodies for which a shape also defines a plain JSON form."""


class Demand(Enum):
    """A demand that a write has in its header fields.

    A handler that ignored it would do what the client has excluded.
    """

    DRY_RUN = "Prefer: dry-run"
    RESPONSE = "Prefer: return, respond-async, wait"
    IDEMPOTENCY_KEY = "Idempotency-Key"
    LOCK_TOKEN = "Lock-Token"  # noqa: S105 (the name of a field)
    PRECONDITIONS = "If-Match, If-None-Match"
    """Evaluated by the core, except for resources that an extension answers itself (``Resource.remote``)."""
    OTHER_PRECONDITIONS = "If-Unmodified-Since, If"


Honours = frozenset[Demand]
NOTHING: Final[Honours] = frozenset()
EVERYTHING: Final[Honours] = frozenset(Demand)
"""For methods that change nothing, and for stops, which no field prevents."""


def honoured_by(affordance: object) -> Honours:
    """Return the demands that the handler honours: ``honours`` of the affordance, without it nothing."""
    found: Honours = getattr(affordance, "honours", NOTHING)
    return found


def rights_to_read(affordance: object) -> tuple[Right, ...]:
    """Return the rights, one of which is needed to read the resource: ``reading`` of the affordance, else READ."""
    found: tuple[Right, ...] = getattr(affordance, "reading", (Right.READ,))
    return found


class Affordance(Protocol):
    """Attributes of all affordances. An extension brings its own type together with a handler.

    The handler of an affordance with an attribute ``honours``, a set of demands, honours these. The core refuses all
    others before it calls the handler.
    """

    @property
    def methods(self) -> tuple[str, ...]: ...

    @property
    def body_types(self) -> tuple[str, ...]:
        """Accepted media types of bodies; empty if there is no body."""

    @property
    def needs(self) -> tuple[Right, ...]:
        """Rights, one of which is needed."""

    @property
    def reads(self) -> bool:
        """True if its methods are safe (RFC 9110, 9.2.1)."""


_OF_MOTIONS: Final = frozenset({Demand.DRY_RUN, Demand.RESPONSE, Demand.IDEMPOTENCY_KEY, Demand.LOCK_TOKEN})
_OF_LEASES: Final = frozenset({Demand.LOCK_TOKEN})


class _Writes:
    reads: ClassVar[bool] = False


@dataclass(frozen=True)
class Invoke(_Writes):
    """Run an action."""

    offer: Offer

    @property
    def methods(self) -> tuple[str, ...]:
        return self.offer.methods

    @property
    def body_types(self) -> tuple[str, ...]:
        return FORM_TYPES if self.offer.takes_body else ()

    @property
    def needs(self) -> tuple[Right, ...]:
        return self.offer.needs

    @property
    def honours(self) -> Honours:
        return EVERYTHING if self.offer.is_stop else _OF_MOTIONS


@dataclass(frozen=True)
class EndInvocation(_Writes):
    """Stop an invocation: by DELETE, or by its action ``cancel``, which keeps the invocation."""

    invocation: Invocation
    keep_record: bool
    body_types: ClassVar[tuple[str, ...]] = ()
    honours: ClassVar[Honours] = EVERYTHING - {Demand.DRY_RUN}

    @property
    def methods(self) -> tuple[str, ...]:
        return ("POST",) if self.keep_record else ("DELETE",)

    @property
    def needs(self) -> tuple[Right, ...]:
        return (Right.STOP,) if self.keep_record else (Right.ACT,)


@dataclass(frozen=True)
class PutSetting(_Writes):
    """Replace the value of a property that clients may set, or remove it."""

    setting: Setting
    needs: ClassVar[tuple[Right, ...]] = (Right.ADMIN,)
    honours: ClassVar[Honours] = _OF_LEASES

    @property
    def methods(self) -> tuple[str, ...]:
        return ("PUT", "PATCH", "DELETE") if self.setting.removable else ("PUT", "PATCH")

    @property
    def body_types(self) -> tuple[str, ...]:
        return BODY_TYPES if self.setting.shape is None else FORM_TYPES


@dataclass(frozen=True)
class PutTarget(_Writes):
    """Command a joint through its target property, with the motion of ``offer``."""

    offer: Offer
    methods: ClassVar[tuple[str, ...]] = ("PUT",)
    body_types: ClassVar[tuple[str, ...]] = FORM_TYPES
    needs: ClassVar[tuple[Right, ...]] = (Right.ACT,)
    honours: ClassVar[Honours] = _OF_MOTIONS


@dataclass(frozen=True)
class Control(_Writes):
    """Take, renew or release the control lease of a robot."""

    robot: Robot
    methods: ClassVar[tuple[str, ...]] = ("PUT", "DELETE")
    body_types: ClassVar[tuple[str, ...]] = FORM_TYPES
    needs: ClassVar[tuple[Right, ...]] = (Right.ACT,)
    honours: ClassVar[Honours] = _OF_LEASES


@dataclass(frozen=True)
class ForgetRobot(_Writes):
    """Remove a robot that has gone for good, with its settings."""

    robot: Robot
    methods: ClassVar[tuple[str, ...]] = ("DELETE",)
    body_types: ClassVar[tuple[str, ...]] = ()
    needs: ClassVar[tuple[Right, ...]] = (Right.ADMIN,)
    honours: ClassVar[Honours] = _OF_LEASES


@dataclass(frozen=True)
class Subscribe(_Writes):
    """Create a subscription of the thing at ``owner``."""

    owner: str
    methods: ClassVar[tuple[str, ...]] = ("POST",)
    body_types: ClassVar[tuple[str, ...]] = BODY_TYPES
    needs: ClassVar[tuple[Right, ...]] = (Right.SUBSCRIBE,)


@dataclass(frozen=True)
class ChangeSubscription(_Writes):
    """Change the options of a subscription, or delete it."""

    record: Record
    methods: ClassVar[tuple[str, ...]] = ("PATCH", "DELETE")
    body_types: ClassVar[tuple[str, ...]] = BODY_TYPES
    needs: ClassVar[tuple[Right, ...]] = (Right.SUBSCRIBE, Right.ADMIN)


@dataclass(frozen=True)
class ResumeSubscription(_Writes):
    record: Record
    methods: ClassVar[tuple[str, ...]] = ("POST",)
    body_types: ClassVar[tuple[str, ...]] = ()
    needs: ClassVar[tuple[Right, ...]] = (Right.SUBSCRIBE, Right.ADMIN)
