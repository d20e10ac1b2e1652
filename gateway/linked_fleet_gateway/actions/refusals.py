"""HTTP errors for refusals by the robot, its agent or the store."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from datetime import UTC, datetime
from typing import cast

from linked_fleet_agent.wire.messages import RefusalCode, Refused
from linked_fleet_gateway.actions.store import KeyReused, LeaseHeld, LeaseOver, StoreUnavailable
from linked_fleet_gateway.base.errors import (
    AgentSilent,
    Changed,
    Conflict,
    Controlled,
    MotionRefused,
    RefusedByAgent,
    StoreAway,
)
from linked_fleet_gateway.base.errors import KeyReused as KeyReusedError
from linked_fleet_gateway.fleet.invocations import Invocation
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.resources.invocation import invocation_path


def lease_of(robot: Robot) -> str:
    if robot.lease is None:
        raise Conflict(f"Nobody has the control lease of {robot.name}; take it, and the motion can be tied to it.")
    return robot.lease.id


def refusal(robot: Robot, reply: Refused) -> Conflict:
    if reply.code == "expectation":
        return Changed(f"The precondition does not hold: {reply.reason}")
    return RefusedByAgent(f"The agent of {robot.name} refused ({reply.code}): {reply.reason}")


def raise_first_refusal(robot: Robot, invocation: Invocation) -> None:
    """Raise the error that answered the original request, unless its agent accepted it."""
    if (guarded := MotionRefused.coded(invocation.refused)) is not None:
        raise guarded(f"The motion was not begun: {invocation.reason}.", reason=invocation.reason)
    if invocation.refused:
        raise refusal(robot, Refused(invocation.id, cast(RefusalCode, invocation.refused), invocation.reason))
    if not invocation.accepted and not invocation.state.terminal:
        raise agent_silent(invocation, "not to the first request with this Idempotency-Key either")
    if not invocation.accepted:
        raise AgentSilent(
            f"The agent of {robot.name} did not answer the first request with this key; since: {invocation.reason}.",
            headers={"location": invocation_path(invocation)},
        )


def agent_silent(invocation: Invocation, why: str) -> AgentSilent:
    return AgentSilent(
        f"The agent of {invocation.robot} gave no answer: {why}. The invocation stays until that is settled.",
        headers={"location": invocation_path(invocation)},
    )


@asynccontextmanager
async def store_errors() -> AsyncIterator[None]:
    """Translate errors of the store into HTTP errors."""
    try:
        yield
    except LeaseHeld as error:
        lease = error.lease
        until = datetime.fromtimestamp(lease.expires_ns / 1e9, UTC).isoformat(timespec="seconds")
        raise Controlled(
            f"{lease.holder} controls {lease.robot} until {until}; only stopping is open to everybody.",
            holder=lease.holder,
            expires=until,
        ) from error
    except LeaseOver as error:
        raise Conflict("The control lease is not held any more; take it, and the motion can be tied to it.") from error
    except KeyReused as error:
        raise KeyReusedError(
            "This Idempotency-Key was used for another request within a day; each request needs its own."
        ) from error
    except StoreUnavailable as error:
        raise StoreAway(f"Redis is away: {error}. Stopping is possible nevertheless.") from error
