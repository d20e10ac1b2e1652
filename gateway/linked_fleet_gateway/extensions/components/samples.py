"""The messages of a stream: samples that a client sends, and what it is told about the robot."""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from typing import Annotated, Any

import msgspec
from msgspec import Meta, Raw, Struct
from websockets.frames import CloseCode

from linked_fleet_agent.wire.components import COMPONENTS_VERSION, MAX_SAMPLE_BYTES, Sample, read_value
from linked_fleet_agent.wire.messages import StreamCounts
from linked_fleet_gateway.api import Invocation, Robot
from linked_fleet_gateway.extensions.components.component import DeclaredComponent
from linked_fleet_gateway.extensions.components.offers import ComponentOffer
from linked_fleet_gateway.faces import invocation_path

LEAST_APART_S = 0.005
"""Least time between two samples that are sent on."""
MOST_A_SECOND, BURST = 200.0, 400.0
"""Messages that a client may send on average, and at once after a pause of the gateway."""
PERIOD_S = 1 / 60
"""Least time between two messages to the client."""
UNCHANGED_S = 0.25
"""A message is sent after this time, even if nothing has changed, so that clients notice a lost connection."""
_US = 1_000


class Unusable(Exception):  # noqa: N818 - an outcome that ends the connection
    """A message that ends its stream, with the code for the close frame (RFC 6455, 7.4)."""

    def __init__(self, code: int, reason: str) -> None:
        super().__init__(reason)
        self.code = code


class Said(Struct, frozen=True, forbid_unknown_fields=True):
    """A sample as a client sends it; ``seen`` is the robot's time in seconds that its device has shown last."""

    seen: Annotated[float, Meta(ge=0, le=9e9)]
    input: Raw


Guard = Callable[[Raw], Awaitable[Raw]]
"""Returns the input of a sample as the guards of motions let it be."""
_DECODER = msgspec.json.Decoder(Said)


class Samples:
    """The samples of one stream. Times are seconds of the event loop's clock."""

    def __init__(
        self, offer: ComponentOffer, invocation: Invocation, send: Callable[[Sample], bool], guard: Guard
    ) -> None:
        assert offer.declared is not None
        assert offer.declared.input is not None
        self._schema, self._invocation, self._send, self._guard = offer.declared.input, invocation, send, guard
        self._checking: asyncio.Task[None] | None = None
        self._number = 0
        self._credit, self._counted_s = BURST, 0.0
        self._next: Said | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._sent_s = float("-inf")
        self.superseded = 0
        """Number of samples dropped here because newer ones came at once."""

    def take(self, message: str | bytes, now_s: float) -> None:
        """Send a sample on, or keep it for a moment as the newest. Raises Unusable."""
        self._count(now_s)
        said = self._read(message)
        self.superseded += self._next is not None
        self._next = said
        if self._timer is None and self._checking is None:
            wait_s = self._sent_s + LEAST_APART_S - now_s
            if wait_s <= 0:
                self._flush(now_s)
            else:
                self._timer = asyncio.get_running_loop().call_later(wait_s, self._flush, now_s + wait_s)

    def close(self) -> None:
        """Send nothing more."""
        if self._timer is not None:
            self._timer.cancel()
        if self._checking is not None:
            self._checking.cancel()
        self._next = None

    def _flush(self, now_s: float) -> None:
        said, self._next, self._timer, self._sent_s = self._next, None, None, now_s
        if said is None or self._invocation.state.terminal:
            return
        self._checking = asyncio.create_task(self._check(said), name=f"check a sample of {self._invocation.id}")

    async def _check(self, said: Said) -> None:
        """Send a sample on as the guard lets it be, and then the newest one that has come meanwhile."""
        try:
            self._pass_on(said.seen, await self._guard(said.input))
        finally:
            self._checking = None
        self._flush(asyncio.get_running_loop().time())

    def _pass_on(self, seen_s: float, given: Raw) -> None:
        self._number += 1
        seen_ns = round(seen_s * 1e6) * _US
        self._send(
            Sample(
                version=COMPONENTS_VERSION, id=self._invocation.id, incarnation=self._invocation.incarnation,
                number=self._number, seen_ns=seen_ns, input=given,
            )
        )  # fmt: skip

    def _count(self, now_s: float) -> None:
        self._credit = min(BURST, self._credit + (now_s - self._counted_s) * MOST_A_SECOND) - 1
        self._counted_s = now_s
        if self._credit < 0:
            raise Unusable(CloseCode.POLICY_VIOLATION, f"Send at most {MOST_A_SECOND:g} samples a second.")

    def _read(self, message: str | bytes) -> Said:
        try:
            said = _DECODER.decode(message)
        except (msgspec.MsgspecError, UnicodeError, RecursionError) as error:
            raise Unusable(CloseCode.INVALID_DATA, f'Send {{"seen": SECONDS, "input": {{…}}}}: {error}') from error
        value, problem = read_value(self._schema, said.input, MAX_SAMPLE_BYTES)
        if problem or value is None:
            raise Unusable(CloseCode.INVALID_DATA, f"The input is refused: {problem or 'null is none'}")
        return said


class Reports:
    """Messages to the client of a stream: the robot's time, who drives, what became of its samples, and values."""

    def __init__(
        self, part: DeclaredComponent, robot: Robot, invocation: Invocation, samples: Samples, base: str
    ) -> None:
        self._part, self._robot, self._invocation, self._samples = part, robot, invocation, samples
        self.limited, self.speed_share = "", 1.0
        self._iri = base + invocation_path(invocation)
        self._told: Mapping[str, Any] = {}
        self._before: dict[str, Any] | None = None
        self._sent_s = float("-inf")

    def due(self, now_s: float) -> bytes | None:
        """Return the message for the client; None if it would say nothing new."""
        facts, values = self._facts(), self._values()
        unchanged = facts == self._before and all(self._told.get(name) == value for name, value in values.items())
        if unchanged and now_s - self._sent_s < UNCHANGED_S:
            return None
        message = dict(facts)
        if self._before is None:
            message["invocation"] = self._iri
        if news := {name: value for name, value in values.items() if self._told.get(name, ...) != value}:
            message["values"] = news
        self._before, self._told, self._sent_s = facts, values, now_s
        return msgspec.json.encode(message)

    def last(self, reason: str) -> bytes:
        """Return the message about the end."""
        return msgspec.json.encode(self._facts() | {"reason": reason, "ended": True})

    def _facts(self) -> dict[str, Any]:
        robot, invocation = self._robot, self._invocation
        robot.adopt_latest_frame()
        at_ns = None if robot.frame is None else robot.frame.monotonic_ns
        counts = invocation.stream or StreamCounts()
        dropped = {name: getattr(counts, name) for name in ("late", "reordered", "future", "invalid")}
        lease = robot.lease
        return {
            "time": None if at_ns is None else at_ns // _US / 1e6,
            "state": invocation.state.value,
            "driver": invocation.client if lease is None else lease.holder,
            "priority": None if lease is None else lease.priority,
            "applied": counts.applied,
            "dropped": dropped | {"superseded": self._samples.superseded},
            "silent": counts.silent,
            "speedScale": round(self.speed_share, 2),
            "limitedBecause": self.limited,
            "reason": invocation.reason,
        }

    def _values(self) -> Mapping[str, Any]:
        """Return the known values of the component."""
        part = self._part
        return dict(part.state.values) if part.is_current else {}
