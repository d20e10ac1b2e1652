"""The actions of people on requests for control: they ask, hand over and refuse."""

import time
from collections.abc import Callable, Mapping
from functools import partial

from msgspec.structs import replace

from linked_fleet_base.errors import InsufficientScope
from linked_fleet_gateway.api import (
    ActionRequest,
    Call,
    Conflict,
    Container,
    Core,
    NamedNode,
    NotFound,
    Operation,
    Right,
    Table,
    UnprocessableContent,
    robot_path,
)
from linked_fleet_gateway.extensions.people.control_request import (
    ASK_S,
    ControlRequest,
    describe_request,
    read_request,
)
from linked_fleet_gateway.extensions.people.terms import LF
from linked_fleet_gateway.faces import Identity, Tree

SEGMENT = "control-requests"
MOST = 500
LEASE_S = 120.0
"""The lease that somebody gets to whom control is handed over; pages renew it."""


def container_of(core: Core, records: Table[ControlRequest]) -> Container[ControlRequest]:
    return Container(
        segment=SEGMENT, title="Requests for control", type=LF.ControlRequests, member_type=LF.ControlRequest,
        records=records, shape=LF.ControlRequestInput, read=read_request, describe=describe_request,
        title_of=lambda each: f"{each.by} asks for control of {each.robot}", writing=(Right.ACT,),
        check=_check, owned=_is_own, signed=partial(_signed, core, records),
        visible=lambda each, sees: sees.includes(each.robot),
    )  # fmt: skip


async def _check(record: ControlRequest, tree: Tree, caller: Identity) -> None:
    """Raise UnprocessableContent for an unknown robot, InsufficientScope, Conflict if there is nobody to be asked."""
    robot = tree.view.robots.get(record.robot)
    if robot is None or record.iri != tree.view.base + robot_path(record.robot):
        raise UnprocessableContent(f"There is no robot at {record.iri[:100]}; ofRobot is the address of one.")
    if not caller.has_right(Right.ACT, record.robot):
        raise InsufficientScope("Control of this robot takes the right to act there.", scope=Right.ACT)
    if robot.lease is None:
        raise Conflict("Nobody has control of this robot: take it by PUT of its lease.")


def _is_own(record: ControlRequest, caller: Identity, client: str) -> bool:
    """Return True for who asks: another must not put a request of its own in its place before it is answered."""
    return record.client == client or caller.has_right(Right.ADMIN, record.robot)


def _signed(
    core: Core, records: Table[ControlRequest], record: ControlRequest, caller: Identity, client: str
) -> ControlRequest:
    """Return a request with who asks. Raises Conflict for a second one of the same client and robot."""
    now_ns = time.time_ns()
    for each in records.known.values():
        if (each.robot, each.client) == (record.robot, client) and each.state == "asked" and each.ends_ns > now_ns:
            raise Conflict(f"You have asked for control of {record.robot} already; delete that request first.")
    return replace(
        record,
        iri="",
        token=core.kept_token(record.token),
        by=caller.name or f"somebody at {client}",
        client=client,
        may_be_person=caller.has_right(Right.PERSON, record.robot),
        asked_ns=now_ns,
        ends_ns=now_ns + int(ASK_S * 1e9),
    )


def handlers(core: Core, records: Table[ControlRequest]) -> Mapping[NamedNode, Callable[[ActionRequest], Operation]]:
    """Return the handlers of the actions of a request, which those invoke who have control."""

    async def answer(id: str, call: Call, *, grants: bool) -> None:
        record = records.known.get(id)
        robot = None if record is None else core.robots.get(record.robot)
        if record is None or robot is None:
            raise NotFound("This request for control has ended.")
        if record.state != "asked" or record.ends_ns <= time.time_ns():
            raise Conflict("This request for control was answered already, or it was too late.")
        token = call.caller.lease_token
        if not token or not await core.has_control(robot, token):
            raise Conflict(f"Only who has control of {record.robot} answers this, with its Lock-Token.")
        if not call.caller.identity.has_right(Right.ACT, record.robot):
            raise InsufficientScope("Control of this robot takes the right to act there.", scope=Right.ACT)
        holder = call.client if robot.lease is None else robot.lease.holder
        if grants and not await core.hand_over_control(
            robot, token, record.token, record.by, LEASE_S, may_be_person=record.may_be_person
        ):
            raise Conflict("Your control has just ended: whoever asked may take it.")
        answered = record.answered("granted" if grants else "refused", call.client, time.time_ns())
        if records.known.get(id) is not record or not await records.change(id, answered):  # withdrawn meanwhile
            if grants:
                is_person = call.caller.identity.has_right(Right.PERSON, record.robot)
                await core.hand_over_control(robot, record.token, token, holder, LEASE_S, may_be_person=is_person)
            raise Conflict("This request for control has just been withdrawn.")
        call.accept()

    def handle(request: ActionRequest, *, grants: bool) -> Operation:
        record = records.known.get(request.member_id)
        about = () if record is None else (record.robot,)
        return Operation(lambda call: answer(request.member_id, call, grants=grants), about=about)

    return {LF.HandOverControl: partial(handle, grants=True), LF.RefuseControl: partial(handle, grants=False)}


async def forget_ended(records: Table[ControlRequest]) -> None:
    """Remove the requests that have ended. Raises RedisUnavailable."""
    now_ns = time.time_ns()
    for id, each in list(records.known.items()):
        if each.ends_ns <= now_ns:
            await records.change(id, None)
