"""The rights of a rule: those of its creator at the time of the check."""

import time

from linked_fleet_gateway.base.errors import InsufficientScope, UnprocessableContent
from linked_fleet_gateway.extensions.rules.rule import Rule
from linked_fleet_gateway.extensions.rules.rule_invocation import find_action
from linked_fleet_gateway.identity.rights import EVERYBODY, Identity, Right
from linked_fleet_gateway.identity.service import Identities
from linked_fleet_gateway.resources.tree import Tree


class RightsEnded(Exception):  # noqa: N818
    """The creator may no longer have the rule. A sentence for people."""


def creator_of(rule: Rule, identities: Identities | None) -> Identity:
    """Return the identity that the rule acts for; everybody if authentication is off. Raises RightsEnded."""
    if identities is None:
        return EVERYBODY
    now_ns = time.time_ns()
    if rule.claims is not None:
        now = identities.roster.identity(rule.claims, now_ns)
    else:
        now = identities.roster.holder(rule.creator, now_ns)
    if now is None or not may_have_rules(now):
        raise RightsEnded("the rights of its creator ended")
    if now.sees != rule.view:
        raise RightsEnded("its creator sees other robots now than when it was written; it has to be written again")
    return now


def may_have_rules(identity: Identity) -> bool:
    """Return True if the identity may have rules.

    It must be able to subscribe to all that it reads, because a condition reveals changes, and to act on or stop some
    robot.
    """
    reads = identity.may(Right.READ, None) and identity.over(Right.SUBSCRIBE).covers(identity.sees)
    return reads and identity.may_any((Right.ACT, Right.STOP), None)


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
