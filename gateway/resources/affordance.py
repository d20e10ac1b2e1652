"""What can be done to a resource besides reading it; one type each, by which requests are dispatched.

``needs`` are the rights of which one is needed for it.
"""

from dataclasses import dataclass
from typing import ClassVar, Protocol

from gateway.fleet.invocations import Invocation
from gateway.fleet.robot import Robot
from gateway.identity.rights import Right
from gateway.resources.action_offer import Offer
from gateway.resources.setting import Setting
from gateway.resources.subscription import Record


class Affordance(Protocol):
    """What all of them tell. A wing of the tree brings its own, and what carries it out."""

    @property
    def methods(self) -> tuple[str, ...]: ...

    @property
    def takes_body(self) -> bool: ...

    @property
    def needs(self) -> tuple[Right, ...]: ...


@dataclass(frozen=True)
class Invoke:
    """Run an action."""

    offer: Offer

    @property
    def methods(self) -> tuple[str, ...]:
        return self.offer.methods

    @property
    def takes_body(self) -> bool:
        return self.offer.takes_body

    @property
    def needs(self) -> tuple[Right, ...]:
        """What takes a body moves; the others stop."""
        return (Right.ACT,) if self.takes_body else (Right.STOP,)


@dataclass(frozen=True)
class EndInvocation:
    """Stop an invocation, by deleting it, or by its own action ``cancel``, after which it stays."""

    invocation: Invocation
    keep: bool
    takes_body: ClassVar[bool] = False

    @property
    def methods(self) -> tuple[str, ...]:
        return ("POST",) if self.keep else ("DELETE",)

    @property
    def needs(self) -> tuple[Right, ...]:
        return (Right.STOP,) if self.keep else (Right.ACT,)


@dataclass(frozen=True)
class PutSetting:
    """Replace the value of a property that clients may set, or take it back."""

    setting: Setting
    takes_body: ClassVar[bool] = True
    needs: ClassVar[tuple[Right, ...]] = (Right.ADMIN,)

    @property
    def methods(self) -> tuple[str, ...]:
        return ("PUT", "PATCH", "DELETE") if self.setting.removable else ("PUT", "PATCH")


@dataclass(frozen=True)
class PutTarget:
    """Command a joint by its target property; the same motion as by ``offer``."""

    offer: Offer
    methods: ClassVar[tuple[str, ...]] = ("PUT",)
    takes_body: ClassVar[bool] = True
    needs: ClassVar[tuple[Right, ...]] = (Right.ACT,)


@dataclass(frozen=True)
class Control:
    """Take, renew or release the control lease of a robot."""

    robot: Robot
    methods: ClassVar[tuple[str, ...]] = ("PUT", "DELETE")
    takes_body: ClassVar[bool] = True
    needs: ClassVar[tuple[Right, ...]] = (Right.ACT,)


@dataclass(frozen=True)
class Subscribe:
    """Make a subscription of the thing at ``owner``."""

    owner: str
    methods: ClassVar[tuple[str, ...]] = ("POST",)
    takes_body: ClassVar[bool] = True
    needs: ClassVar[tuple[Right, ...]] = (Right.SUBSCRIBE,)


@dataclass(frozen=True)
class ChangeSubscription:
    """Change the options of a subscription, or end it."""

    record: Record
    methods: ClassVar[tuple[str, ...]] = ("PATCH", "DELETE")
    takes_body: ClassVar[bool] = True
    needs: ClassVar[tuple[Right, ...]] = (Right.SUBSCRIBE, Right.ADMIN)


@dataclass(frozen=True)
class ResumeSubscription:
    record: Record
    methods: ClassVar[tuple[str, ...]] = ("POST",)
    takes_body: ClassVar[bool] = False
    needs: ClassVar[tuple[Right, ...]] = (Right.SUBSCRIBE, Right.ADMIN)
