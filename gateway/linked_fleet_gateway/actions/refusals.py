"""Reasons to refuse a request of an action, and their HTTP errors.

The robot, its agent or the store may refuse. The limit of running motions of one client is counted locally, without
queries to other gateways. After a stall of this process (frozen, starved or suspended) received requests are old, so
stalls are detected.
"""

import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from typing import cast

from linked_fleet_agent.wire.messages import RefusalCode, Refused
from linked_fleet_base.errors import (
    AgentTimeout,
    Changed,
    Conflict,
    Controlled,
    MotionRefused,
    RefusedByAgent,
    StopOwed,
    StopUnanswered,
    TooManyInvocations,
)
from linked_fleet_base.errors import KeyReused as KeyReusedError
from linked_fleet_gateway.actions.store import KeyReused, LeaseHeld, LeaseNotHeld
from linked_fleet_gateway.resources.invocation import invocation_path
from linked_fleet_state.invocation import NOT_BEGUN
from linked_fleet_state.invocations import Invocation, Invocations
from linked_fleet_state.robot import Robot


def required_lease_id(robot: Robot) -> str:
    if robot.lease is None:
        raise Conflict(f"Nobody has the control lease of {robot.name}; take it, and the motion can be tied to it.")
    return robot.lease.id


def agent_refusal(robot: Robot, reply: Refused) -> Conflict:
    if reply.code == "expectation":
        return Changed(f"The precondition does not hold: {reply.reason}")
    return RefusedByAgent(f"The agent of {robot.name} refused ({reply.code}): {reply.reason}")


def raise_first_refusal(robot: Robot | None, invocation: Invocation) -> None:
    """Raise the error that answered the original request, unless its agent accepted it."""
    if robot is None or invocation.operation:
        _raise_first_refusal_of_operation(invocation)
        return
    if (guarded := MotionRefused.type_for_code(invocation.refused)) is not None:
        raise guarded(f"The motion was not begun: {invocation.reason}.", reason=invocation.reason)
    if invocation.refused and invocation.refused != NOT_BEGUN:
        raise agent_refusal(robot, Refused(invocation.id, cast(RefusalCode, invocation.refused), invocation.reason))
    if not invocation.accepted and not invocation.state.terminal:
        raise agent_timeout(invocation, "not to the first request with this Idempotency-Key either")
    if not invocation.accepted:
        raise AgentTimeout(
            f"The agent of {robot.name} has not accepted the first request with this key: {invocation.reason}.",
            headers={"location": invocation_path(invocation)},
        )


def _raise_first_refusal_of_operation(invocation: Invocation) -> None:
    if not invocation.accepted:
        raise Conflict(
            "The first request with this Idempotency-Key was refused: "
            f"{invocation.reason or 'it was not accepted in time'}. Another request needs another key."
        )


def agent_timeout(invocation: Invocation, reason: str) -> AgentTimeout:
    return AgentTimeout(
        f"The agent of {invocation.robot} gave no answer: {reason}. The invocation stays until that is settled.",
        headers={"location": invocation_path(invocation)},
    )


def owed_stop_refusal(robot: str, asked_ns: int) -> StopOwed:
    """Return the refusal of a motion because a stop that was asked for at ``asked_ns`` (wall time) is not confirmed."""
    asked = datetime.fromtimestamp(asked_ns / 1e9, UTC).isoformat(timespec="seconds")
    return StopOwed(
        f"The agent of {robot} has not confirmed the stop of {asked}. It is sent before any motion, as soon as the "
        "agent is heard from. Ask again then.",
        reason="an earlier stop was not confirmed",
    )


MAX_NAMED = 1000
"""Most robots in each list of a problem."""


def unanswered_stop(unanswered: Sequence[str], answered: Sequence[str], location: str) -> StopUnanswered:
    """Return the error for a stop that robots have not confirmed, of which ``unanswered`` are those to name.

    ``location`` is the path of its invocation, or empty.
    """
    some = f"{len(unanswered)} robots ({name_some(unanswered)}) have" if unanswered else "Some robots have"
    whose = f"The agent of {unanswered[0]} has" if len(unanswered) == 1 else some
    others = {0: "", 1: f" {name_some(answered)} has."}.get(len(answered), f" The other {len(answered)} have.")
    return StopUnanswered(
        f"{whose} not confirmed the stop.{others} It is sent again, before anything else, until it is "
        "confirmed. Use the hardware stop if a robot moves.",
        unanswered=unanswered[:MAX_NAMED],
        answered=answered[:MAX_NAMED],
        headers={"location": location} if location else {},
    )


def name_some(robots: Iterable[str], most: int = 10) -> str:
    """Return the names of robots, at most ``most`` of them, as part of a sentence."""
    found = sorted(robots)
    shown = ", ".join(found[:most])
    return shown if len(found) <= most else f"{shown} and {len(found) - most} others"


@contextmanager
def translate_store_errors() -> Iterator[None]:
    """Translate errors of the store into HTTP errors."""
    try:
        yield
    except LeaseHeld as error:
        lease = error.lease
        until = datetime.fromtimestamp(lease.expires_ns / 1e9, UTC).isoformat(timespec="seconds")
        as_whom = ", as a person" if lease.priority == "person" else ""
        raise Controlled(
            f"{lease.holder} controls {lease.robot} until {until}{as_whom}; only stopping is open to everybody.",
            holder=lease.holder,
            expires=until,
        ) from error
    except LeaseNotHeld as error:
        raise Conflict("The control lease is not held any more; take it, and the motion can be tied to it.") from error
    except KeyReused as error:
        raise KeyReusedError(
            "This Idempotency-Key was used for another request within a day; each request needs its own."
        ) from error


class MotionQuota:
    """Allows ``limit`` running motions per client. Those of other gateways count as soon as they are known here."""

    def __init__(self, invocations: Invocations, limit: int) -> None:
        self._invocations, self._limit = invocations, limit
        self._beginning: Counter[str] = Counter()

    def is_exhausted(self, client: str) -> bool:
        return self._invocations.motions_by(client) + self._beginning[client] >= self._limit

    def limit_error(self, client: str) -> TooManyInvocations:
        return TooManyInvocations(
            f"{client or 'The client'} has as many motions that have not ended as it may have, {self._limit}. "
            "Wait until some have ended, cancel them, or move several joints by one motion."
        )

    @contextmanager
    def count_start(self, client: str) -> Iterator[bool]:
        """Count a motion that is being started, and yield True if the client has reached its limit."""
        full = self.is_exhausted(client)
        self._beginning[client] += 1
        try:
            yield full
        finally:
            self._beginning[client] -= 1
            if not self._beginning[client]:
                del self._beginning[client]


TICK_S = 0.25
STALL_S = 2.0
"""Duration of a stall after which robots may have given up this gateway and hold."""
CATCH_UP_S = 0.25
"""Time in which messages buffered during a stall are read."""


class StallDetector:
    """Detects stalls by the monotonic clock, which advances while a process is frozen."""

    def __init__(self) -> None:
        self._ticked_s = time.monotonic()
        self._resumed_s = -CATCH_UP_S

    async def tick(self) -> None:
        """Record that this process runs; call it every ``TICK_S``."""
        self._tick()

    def stalled_recently(self) -> bool:
        """Return True during a stall, or so soon after one that a request may have arrived before its end."""
        self._tick()
        return time.monotonic() - self._resumed_s < CATCH_UP_S

    def elapsed_ns(self, began_ns: int) -> int:
        """Return the time since ``began_ns`` (monotonic), or 0 if this process was stalled in it.

        So a motion is not late by the time that a check or a plan takes, and is late after a stall.
        """
        self._tick()
        return 0 if self._resumed_s >= began_ns / 1e9 else time.monotonic_ns() - began_ns

    def _tick(self) -> None:
        now_s = time.monotonic()
        if now_s - self._ticked_s > STALL_S:
            self._resumed_s = now_s
        self._ticked_s = now_s
