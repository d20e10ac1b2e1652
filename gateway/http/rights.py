"""Who asks, what he sees of the tree, and what he may do there."""

from collections.abc import Sequence

from starlette.requests import HTTPConnection

from gateway.base.errors import InsufficientScope
from gateway.identity.rights import EVERYBODY, Identity, Right
from gateway.resources.paths import is_public, robot_of
from gateway.resources.subscription import Depth, Record
from gateway.resources.tree import EMPTY, Shelf, Tree
from gateway.subscriptions.live import Live

SEES_SUBSCRIPTIONS = (Right.SUBSCRIBE, Right.ADMIN)
"""Rights of which one is needed to read a Subscriptions container: ``subscribe`` for one's own, ``admin`` for all."""


def caller_of(connection: HTTPConnection) -> Identity:
    """As ``gateway.http.callers`` found out; where no identities are configured, everybody may do everything."""
    caller: Identity = connection.scope.get("state", {}).get("caller", EVERYBODY)
    return caller


def name_of(connection: HTTPConnection) -> str:
    """The name of who asks, as it is shown and counted; without identities the network address."""
    address = connection.client.host if connection.client else ""
    return caller_of(connection).name or address


def tree_of(connection: HTTPConnection, base: str, shelf: Shelf = EMPTY) -> Tree:
    """The tree as far as who asks may see it."""
    live: Live = connection.app.state.live
    return live.tree(base, caller_of(connection).sees, shelf)


def demand(connection: HTTPConnection, path: str, scopes: Sequence[Right]) -> None:
    """InsufficientScope unless who asks has one of ``scopes`` over what is at ``path``, which he may find."""
    if is_public(path) or caller_of(connection).may_any(scopes, robot_of(path)):
        return
    wanted = " or ".join(scopes)
    raise InsufficientScope(f"This takes the right to {wanted} here, which you do not have.", scope=scopes[0])


def demand_all(connection: HTTPConnection, path: str, depth: Depth) -> None:
    """InsufficientScope for all below the fleet, unless who asks may subscribe to whatever he may read."""
    caller = caller_of(connection)
    if path == "/" and depth is Depth.SUBTREE and not caller.over(Right.SUBSCRIBE).covers(caller.sees):
        raise InsufficientScope("You may read robots that you may not subscribe to.", scope=Right.SUBSCRIBE)


def shown(connection: HTTPConnection, records: Sequence[Record], owner: str) -> list[Record]:
    """The subscriptions of a thing that the caller may see: his own with ``subscribe``, all of them with ``admin``."""
    caller, robot = caller_of(connection), robot_of(owner)
    if caller.may(Right.ADMIN, robot):
        return list(records)
    if not caller.may(Right.SUBSCRIBE, robot):
        return []
    return [each for each in records if caller.name and each.subscription.creator == caller.name]
