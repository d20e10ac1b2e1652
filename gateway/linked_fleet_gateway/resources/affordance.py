"""Affordances of a resource besides reading it; one type each, by which requests are dispatched.

``needs`` are the rights of which one is needed for it.
"""

from dataclasses import dataclass
from typing import ClassVar, Protocol

from linked_fleet_gateway.fleet.invocations import Invocation
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.identity.rights import Right
from linked_fleet_gateway.rdf.serialise import JSON, TEXT_TYPES
from linked_fleet_gateway.resources.action_offer import Offer
from linked_fleet_gateway.resources.setting import Setting
from linked_fleet_gateway.resources.subscription import Record

BODY_TYPES = TEXT_TYPES
"""Media types of RDF that bodies may have. Not Jelly: its parser raises any exception at bytes from strangers."""
FORM_TYPES = (*BODY_TYPES, JSON)
"""Media types of a body where a shape says which members an object in plain JSON has."""


class Affordance(Protocol):
    """The attributes that all of them have. An extension brings its own, and the handler of it."""

    @property
    def methods(self) -> tuple[str, ...]: ...

    @property
    def body_types(self) -> tuple[str, ...]:
        """Media types of bodies that are taken; none if there is no body."""

    @property
    def needs(self) -> tuple[Right, ...]:
        """Rights of which one is needed."""

    @property
    def reads(self) -> bool:
        """Return True if its methods are safe (RFC 9110, 9.2.1), whatever they are called."""


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
        """The rights that an action needs: one that takes a body moves, the others stop."""
        return (Right.ACT,) if self.offer.takes_body else (Right.STOP,)


@dataclass(frozen=True)
class EndInvocation(_Writes):
    """Stop an invocation, by deleting it, or by its own action ``cancel``, after which it stays."""

    invocation: Invocation
    keep: bool
    body_types: ClassVar[tuple[str, ...]] = ()

    @property
    def methods(self) -> tuple[str, ...]:
        return ("POST",) if self.keep else ("DELETE",)

    @property
    def needs(self) -> tuple[Right, ...]:
        return (Right.STOP,) if self.keep else (Right.ACT,)


@dataclass(frozen=True)
class PutSetting(_Writes):
    """Replace the value of a property that clients may set, or take it back."""

    setting: Setting
    needs: ClassVar[tuple[Right, ...]] = (Right.ADMIN,)

    @property
    def methods(self) -> tuple[str, ...]:
        return ("PUT", "PATCH", "DELETE") if self.setting.removable else ("PUT", "PATCH")

    @property
    def body_types(self) -> tuple[str, ...]:
        return BODY_TYPES if self.setting.shape is None else FORM_TYPES


@dataclass(frozen=True)
class PutTarget(_Writes):
    """Command a joint by its target property; the same motion as by ``offer``."""

    offer: Offer
    methods: ClassVar[tuple[str, ...]] = ("PUT",)
    body_types: ClassVar[tuple[str, ...]] = FORM_TYPES
    needs: ClassVar[tuple[Right, ...]] = (Right.ACT,)


@dataclass(frozen=True)
class Control(_Writes):
    """Take, renew or release the control lease of a robot."""

    robot: Robot
    methods: ClassVar[tuple[str, ...]] = ("PUT", "DELETE")
    body_types: ClassVar[tuple[str, ...]] = FORM_TYPES
    needs: ClassVar[tuple[Right, ...]] = (Right.ACT,)


@dataclass(frozen=True)
class Subscribe(_Writes):
    """Make a subscription of the thing at ``owner``."""

    owner: str
    methods: ClassVar[tuple[str, ...]] = ("POST",)
    body_types: ClassVar[tuple[str, ...]] = BODY_TYPES
    needs: ClassVar[tuple[Right, ...]] = (Right.SUBSCRIBE,)


@dataclass(frozen=True)
class ChangeSubscription(_Writes):
    """Change the options of a subscription, or end it."""

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
