"""Invocation of an action for a rule, like a client's request, with the rights of the rule's creator.

The rights are those of the creator at the time of the check.
"""

import time
from collections.abc import Awaitable, Callable, Mapping, Sequence
from hashlib import blake2b
from urllib.parse import unquote

from pyoxigraph import NamedNode, Triple

from linked_fleet_base.errors import InsufficientScope, UnprocessableContent
from linked_fleet_gateway.api import (
    Resource,
    Right,
    robot_of,
)
from linked_fleet_gateway.extensions.rules.edges import Row
from linked_fleet_gateway.extensions.rules.rule import Rule
from linked_fleet_gateway.extensions.rules.template import fill
from linked_fleet_gateway.faces import EVERYBODY, Claims, Identity, Invoke, Offer, Tree
from linked_fleet_gateway.serving import Caller, Identities, RobotTime
from linked_fleet_state.invocations import Invocation

Moments = Mapping[str, RobotTime | None]
CarryOut = Callable[[Offer, str, Caller, Sequence[Triple], RobotTime | None], Awaitable[Invocation]]
"""Carries out an action for a client (``Core.invoke``)."""


class NoAction(UnprocessableContent):
    """There is no such action, perhaps because its robot or component is not known yet."""


def find_action(tree: Tree, path: str, creator: Identity) -> Offer:
    """Return the action at ``path`` if ``creator`` may invoke it. Raises UnprocessableContent, InsufficientScope."""
    found = tree.resolve(path)
    if not isinstance(found, Resource) or not isinstance(found.affords, Invoke):
        raise NoAction(f"There is no action at {path[:200]} that could be invoked.")
    needs = found.affords.needs
    if not creator.has_any_right(needs, robot_of(path)):
        wanted = " or ".join(needs)
        raise InsufficientScope(f"{path[:200]} requires the right to {wanted}, which is missing.", scope=needs[0])
    return found.affords.offer


async def invoke(
    carry_out: CarryOut,
    tree: Tree,
    rule: Rule,
    path: str,
    creator: Identity,
    number: int,
    row: Row,
    moments: Moments,
) -> Invocation:
    """Invoke the action at ``path`` for the firing ``number`` and return the accepted invocation. Raises FleetError.

    ``moments`` are the states of the robots at the evaluation. Commands given to a robot since then, such as a stop,
    take precedence.
    """
    offer = find_action(tree, path, creator)
    statements = fill(rule.body, row, NamedNode(rule.base + offer.path)) if offer.takes_body else ()
    # The key cannot equal a client's key, whose characters are all visible.
    caller = Caller(
        rule.client,
        idempotency_key=f"\x1frule {rule.id} {number}",
        request_digest=blake2b(repr(row).encode(), digest_size=16).hexdigest(),
        stoppable_robots=creator.view_for(Right.STOP),
        visible_robots=creator.visible_robots,
        rule=rule.id,
        identity=creator,
    )
    moment = None if offer.robot is None else moments.get(offer.robot.name)
    return await carry_out(offer, rule.base, caller, statements, moment)


def action_path(rule: Rule, row: Row, bases: Sequence[str]) -> str:
    """Return the path of the action.

    Raises UnprocessableContent for a variable not bound to an action of this fleet.
    """
    if rule.variable is None:
        return rule.invokes
    term = row.get(rule.variable)
    path = path_in_fleet(term.value, (rule.base, *bases)) if isinstance(term, NamedNode) else None
    if path is None:
        detail = f"?{rule.variable} is bound to {str(term)[:200]}, which is not an action of this fleet"
        raise UnprocessableContent(f"{detail}; nothing was requested from anywhere.")
    return path


def path_in_fleet(iri: str, bases: Sequence[str]) -> str | None:
    """Return the path of a resource under one of the public URLs of this fleet; None for other IRIs."""
    base = next((each for each in bases if iri.startswith(each + "/")), None)
    return None if base is None else unquote(iri[len(base) :])


class RightsEnded(Exception):  # noqa: N818
    """The creator lost the right to have the rule; the message is a sentence for people."""


def creator_of(rule: Rule, identities: Identities | None) -> Identity:
    """Return the identity that the rule acts for; everybody if authentication is off. Raises RightsEnded."""
    if identities is None:
        return EVERYBODY
    now = present_identity(identities, rule.creator, rule.claims)
    if now is None or not may_have_rules(now):
        raise RightsEnded("the rights of its creator ended")
    if now.visible_robots != rule.view:
        raise RightsEnded("the robots that its creator sees have changed since it was written; write it again")
    return now


def present_identity(identities: Identities, name: str, claims: Claims | None) -> Identity | None:
    """Return what an identity may do now, which had this name or these claims of an issuer; None if it has ended."""
    roster, now_ns = identities.roster, time.time_ns()
    return roster.holder(name, now_ns) if claims is None else roster.identity(claims, now_ns)


def may_have_rules(identity: Identity) -> bool:
    """Return True if the identity may have rules.

    It must be able to subscribe to all that it reads, because a condition reveals changes, and to act on or stop some
    robot.
    """
    reads = identity.has_right(Right.READ, None) and identity.view_for(Right.SUBSCRIBE).is_superset_of(
        identity.visible_robots
    )
    return reads and identity.has_any_right((Right.ACT, Right.STOP), None)


def check_action(rule: Rule, tree: Tree, creator: Identity) -> None:
    """Raise RightsEnded if the creator may not invoke the rule's fixed action."""
    if rule.variable is not None:
        return
    try:
        find_action(tree, rule.invokes, creator)
    except InsufficientScope as error:
        raise RightsEnded(error.detail) from error
    except UnprocessableContent:
        return
