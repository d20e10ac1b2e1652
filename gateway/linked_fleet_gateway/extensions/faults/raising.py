"""The action by which rules, missions and other clients raise faults."""

from linked_fleet_base.errors import InsufficientScope
from linked_fleet_gateway.api import (
    DCTERMS,
    ActionRequest,
    Call,
    Core,
    NamedNode,
    Operation,
    Right,
    UnprocessableContent,
    robot_of,
    thing_at,
)
from linked_fleet_gateway.extensions.faults.fault import SEVERITIES, Severity, Trouble
from linked_fleet_gateway.extensions.faults.ledger import Ledger
from linked_fleet_gateway.extensions.faults.terms import LF
from linked_fleet_gateway.serving import Caller

_TOLD = "told"
"""The kind of a fault for which the client names none. Kinds of clients are apart from those of gateways."""


def raise_fault(core: Core, ledger: Ledger, request: ActionRequest) -> Operation:
    """Handle ``raiseFault`` of the fleet."""
    trouble = _trouble(request)

    async def rehearse(caller: Caller) -> float:
        _check(core, trouble, caller)
        return 0.0

    async def run(call: Call) -> None:
        await rehearse(call.caller)
        await ledger.record(trouble, call.id)
        call.accept()

    return Operation(run, rehearse=rehearse, about=trouble.robots)


def _trouble(request: ActionRequest) -> Trouble:
    body = request.body
    about, severity = body.node(body.root, LF.about), body.node(body.root, LF.severity)
    assert isinstance(about, NamedNode)
    path = about.value.removeprefix(request.base)
    robot = robot_of(path) if path != about.value else None
    if robot is None:
        raise UnprocessableContent(f"<{about.value[:200]}> is neither a robot of this fleet nor a part of one.")
    return Trouble(
        f"{_TOLD} {body.text(body.root, LF.faultKind) or ''}".strip(),
        path,
        (robot,),
        _severity(severity),
        body.text(body.root, DCTERMS.title) or "",
        latched=body.text(body.root, LF.latched) in ("true", "1"),
        event=True,
    )


def _severity(term: object) -> Severity:
    return next((each for each in SEVERITIES if LF.terms[each] == term), "error")


def _check(core: Core, trouble: Trouble, caller: Caller) -> None:
    """Raise UnprocessableContent for a thing that the caller does not see, InsufficientScope without the right."""
    (robot,) = trouble.robots
    seen = caller.visible_robots.includes(robot)
    if not seen or thing_at(trouble.place, core.robots) is None:
        raise UnprocessableContent(f"There is no robot at {trouble.place[:200]}, and no part of one.")
    if not caller.identity.has_right(Right.ACT, robot):
        raise InsufficientScope(f"Raising a fault takes the right to act on {robot}.", scope=Right.ACT)
