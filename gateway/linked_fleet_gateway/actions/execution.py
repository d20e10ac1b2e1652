"""From an offered action to its invocation: for requests, and for extensions that act for a client."""

import dataclasses
from collections.abc import Mapping, Sequence

from msgspec.structs import replace
from pyoxigraph import NamedNode, Triple

from linked_fleet_gateway.actions.admission import validate_action_body
from linked_fleet_gateway.actions.operations import Operation
from linked_fleet_gateway.actions.plan import ActionRequest, Caller, DeferredPlan, Halt, Motion, RobotTime, robot_time
from linked_fleet_gateway.actions.rehearsals import Rehearsal
from linked_fleet_gateway.actions.service import Actions
from linked_fleet_gateway.resources.action_offer import Offer
from linked_fleet_gateway.resources.body_values import Body, input_ntriples
from linked_fleet_state.invocation import Invocation
from linked_fleet_state.robot import Robot


def empty_body(offer: Offer, base: str) -> Body:
    """Return the body of a request without one."""
    return Body((), NamedNode(base + offer.path))


async def make_plan(
    actions: Actions, offer: Offer, base: str, body: Body, moment: RobotTime | None = None
) -> Motion | Halt | Operation:
    """Return the plan that the handler of the action makes of a body. Raises the handler's errors."""
    plan = actions.plan(ActionRequest(base, body, offer.robot, offer.joint, moment, offer.thing), offer)
    if isinstance(plan, DeferredPlan):
        plan = await actions.compute(plan)
    # A stop takes no lease, and other kinds do not take the right to stop.
    assert not isinstance(plan, Motion if offer.is_stop else Halt)
    return plan


async def carry_out(actions: Actions, offer: Offer, plan: Motion | Halt | Operation, caller: Caller) -> Invocation:
    """Carry out a plan and return its invocation once it is accepted. Raises FleetError."""
    if isinstance(plan, Operation):
        return await actions.operations.operate(offer.path, plan, offer.robot, caller, is_stop=offer.is_stop)
    if isinstance(plan, Halt):
        return await actions.halt(offer.path, plan, caller)
    return await actions.start(offer.path, plan, caller)


async def rehearse(
    actions: Actions,
    offer: Offer,
    base: str,
    caller: Caller,
    statements: Sequence[Triple],
    assumed: Mapping[str, Robot],
) -> Rehearsal:
    """Rehearse an action by the statements of its body, with ``assumed`` robots where they stand. Raises FleetError."""
    body = validate_action_body(offer, statements, base) if offer.takes_body else empty_body(offer, base)
    if offer.robot is not None:
        offer = dataclasses.replace(offer, robot=assumed.get(offer.robot.name, offer.robot))
    plan = await make_plan(actions, offer, base, body, robot_time(offer.robot))
    if isinstance(plan, Motion):
        plan = replace(plan, assumed=assumed)
    return await actions.rehearsals.of(offer, plan, caller)


async def invoke(
    actions: Actions, offer: Offer, base: str, caller: Caller, statements: Sequence[Triple], moment: RobotTime | None
) -> Invocation:
    """Invoke an action by the statements of its body, whose IRIs begin with ``base``. Raises FleetError.

    Without any statement an action whose body is optional gets none.
    """
    body = empty_body(offer, base)
    if offer.takes_body and (statements or not offer.body_is_optional):
        body = validate_action_body(offer, statements, base)
        caller = replace(caller, body=input_ntriples(body))
    return await carry_out(actions, offer, await make_plan(actions, offer, base, body, moment), caller)
