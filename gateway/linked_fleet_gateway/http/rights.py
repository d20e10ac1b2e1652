"""Checks of a caller's rights."""

from collections.abc import Sequence

from linked_fleet_gateway.base.errors import InsufficientScope
from linked_fleet_gateway.http.request import Connection
from linked_fleet_gateway.identity.rights import Right
from linked_fleet_gateway.resources.paths import is_public, robot_of
from linked_fleet_gateway.resources.subscription import Depth, Record

SEES_SUBSCRIPTIONS = (Right.SUBSCRIBE, Right.ADMIN)
"""Rights, one of which is needed to read a Subscriptions container: ``subscribe`` for one's own, ``admin`` for all."""


def require_right(connection: Connection, path: str, scopes: Sequence[Right]) -> None:
    """Raise InsufficientScope unless the caller has one of ``scopes`` on the resource at ``path``."""
    if is_public(path) or connection.caller.may_any(scopes, robot_of(path)):
        return
    wanted = " or ".join(scopes)
    raise InsufficientScope(f"This takes the right to {wanted} here, which you do not have.", scope=scopes[0])


def require_subtree(connection: Connection, path: str, depth: Depth) -> None:
    """Raise InsufficientScope for the subtree of the fleet unless the caller may subscribe to all that it reads."""
    caller = connection.caller
    if path == "/" and depth is Depth.SUBTREE and not caller.over(Right.SUBSCRIBE).covers(caller.sees):
        raise InsufficientScope("You may read robots that you may not subscribe to.", scope=Right.SUBSCRIBE)


def visible_subscriptions(connection: Connection, records: Sequence[Record], owner: str) -> list[Record]:
    """Return the visible subscriptions of a thing: the caller's own with ``subscribe``, all of them with ``admin``."""
    caller, robot = connection.caller, robot_of(owner)
    if caller.may(Right.ADMIN, robot):
        return list(records)
    if not caller.may(Right.SUBSCRIBE, robot):
        return []
    return [each for each in records if caller.name and each.subscription.creator == caller.name]
