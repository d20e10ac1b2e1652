"""Streams of inputs: a WebSocket on an action, whose messages are samples for the agent (docs/DRIVING.md).

The gateway judges nothing about time, and keeps no sample: each goes on at once, or, if they come too fast, the newest.
"""

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from msgspec import Raw, json
from msgspec.structs import replace
from websockets.frames import CloseCode, Opcode

from linked_fleet_base.errors import MotionRefused
from linked_fleet_gateway.api import (
    ActionRequest,
    Core,
    FleetError,
    Invocation,
    Motion,
    NamedNode,
    SubprotocolConnection,
    WebSocket,
    WebSocketHandler,
    cancel_tasks,
)
from linked_fleet_gateway.extensions.components import plans
from linked_fleet_gateway.extensions.components.offers import ComponentOffer, InputBody
from linked_fleet_gateway.extensions.components.samples import PERIOD_S, Reports, Samples, Unusable
from linked_fleet_gateway.faces import Invoke, invocation_path
from linked_fleet_gateway.serving import Act, Caller, frame, robot_time, websocket_caller

log = logging.getLogger(__name__)

SUBPROTOCOL = "lf.drive"
MAX_MESSAGE_BYTES = 2048
_LEFT = "its client has closed the stream"


def takes_stream(affords: Any) -> bool:
    """Return True for an action that takes a stream."""
    return bool(affords.offer.stream_protocol)


class OpenStream:
    """A stream that its agent has accepted, as one invocation."""

    def __init__(
        self, core: Core, offer: ComponentOffer, motion: Motion, invocation: Invocation, caller: Caller, base: str
    ) -> None:
        self._actions, self._caller, self._motion, self._part = core.actions, caller, motion, offer.part
        self._offer = offer
        assert offer.declared is not None
        assert offer.declared.stream is not None
        self._holds_s = offer.declared.stream.silence_s
        self.robot, self.invocation, self.lease = motion.robot, invocation, invocation.lease
        self.reason = _LEFT
        """The reason why the gateway ends it."""
        link, name = core.live.link, motion.robot.name
        self.samples = Samples(offer, invocation, lambda sample: link.send_sample(name, sample), self._guard)
        self._reports = Reports(offer.part, motion.robot, invocation, self.samples, base)

    async def _guard(self, given: Raw) -> Raw:
        """Return the velocities of a sample at the speed at which the way is free until they hold no more."""
        act, reports = self._motion.motion, self._reports
        assert isinstance(act, Act)
        given, share, limited = plans.as_joints(self._offer, given)
        reports.limited, reports.speed_share = limited, share
        drive = plans.drive_of(self._part, act.action, json.decode(given), self._holds_s)
        if drive is None:
            return given
        try:
            motion = replace(self._motion, motion=replace(act, input=bytes(given), drive=drive))
            motion, why = await self._actions.guarded(motion, self._caller, self.invocation.id)
        except MotionRefused as error:
            reports.limited, reports.speed_share = error.reason, 0.0
            return Raw(json.encode(json.decode(given) | drive.standing_input))
        reports.limited, reports.speed_share = why or limited, share * motion.facts.get("speedShare", 1.0)
        assert isinstance(motion.motion, Act)
        return Raw(motion.motion.input)

    async def listen(self, connection: SubprotocolConnection) -> None:
        """Send the samples of the client on until the connection ends. Raises ConnectionEnded."""
        while True:
            message = await connection.receive()
            try:
                self.samples.take(message, asyncio.get_running_loop().time())
            except Unusable as error:
                self.reason = f"its client has sent what is no sample: {error}"
                connection.close_with(error.code, str(error))

    async def tell(self, connection: SubprotocolConnection) -> None:
        """Tell the client about the robot until the invocation has ended or its control is lost."""
        clock = asyncio.get_running_loop()
        while not (ended := self._ended()):
            if (message := self._reports.due(clock.time())) is not None:
                connection.try_send(frame(Opcode.TEXT, message))
            await asyncio.sleep(PERIOD_S)
        self.reason = ended
        connection.try_send(frame(Opcode.TEXT, self._reports.last(ended)))
        connection.close_with(CloseCode.NORMAL_CLOSURE, ended)

    def _ended(self) -> str:
        """Return why the stream has ended or must end, or an empty string."""
        invocation, lease = self.invocation, self.robot.lease
        if invocation.state.terminal:
            return f"{invocation.state}: {invocation.reason}" if invocation.reason else invocation.state.value
        if lease is not None and lease.id != self.lease:
            return f"{lease.holder}{', a person,' if lease.priority == 'person' else ''} has taken control"
        return "the control lease has ended" if self.lease and lease is None else ""


class Streams:
    """The open streams of a gateway."""

    def __init__(self, core: Core) -> None:
        self._core = core
        self._ending = set[asyncio.Task[None]]()

    @property
    def handler(self) -> WebSocketHandler:
        return WebSocketHandler((SUBPROTOCOL,), self._serve, MAX_MESSAGE_BYTES, takes_stream, self._open)

    async def close(self) -> None:
        await cancel_tasks(self._ending)

    @asynccontextmanager
    async def _open(self, websocket: WebSocket, affords: Invoke) -> AsyncIterator[OpenStream]:
        """Begin the invocation, and cancel it at the end. Raises what the same POST is answered with."""
        offer, base = affords.offer, websocket.base
        assert isinstance(offer, ComponentOffer)
        caller, body = websocket_caller(websocket), InputBody((), NamedNode(base + offer.path), {})
        request = ActionRequest(base, body, offer.robot, None, robot_time(offer.robot), offer.thing)
        motion = plans.stream(offer, request)
        if plans.is_hand(offer):
            await asyncio.to_thread(plans.prepare_hand, offer)
        await self._core.live.link.prepare_samples(motion.robot.name)
        invocation = await self._core.actions.start(offer.path, motion, caller)
        stream = OpenStream(self._core, offer, motion, invocation, caller, base)
        websocket.report("stream", 101, invocation_path(invocation))
        try:
            yield stream
        finally:
            stream.samples.close()
            self._end_later(stream)
            websocket.report("end stream", None, invocation_path(invocation))

    async def _serve(self, connection: SubprotocolConnection, stream: OpenStream) -> None:
        telling = asyncio.create_task(stream.tell(connection), name=f"stream {stream.invocation.id}")
        telling.add_done_callback(lambda task: _note_failure(task, connection))
        try:
            await stream.listen(connection)
        finally:
            await cancel_tasks([telling])

    def _end_later(self, stream: OpenStream) -> None:
        """Cancel the invocation in a task of its own, which outlives the connection."""
        if stream.invocation.state.terminal:
            return
        task = asyncio.create_task(self._end(stream), name=f"end {stream.invocation.id}")
        self._ending.add(task)
        task.add_done_callback(self._ending.discard)

    async def _end(self, stream: OpenStream) -> None:
        try:
            await self._core.actions.lifecycle.cancel(stream.invocation, stream.reason)
        except FleetError as error:  # it has ended, or its stop is owed and sent again
            log.info("stream %s: %s", stream.invocation.id, error)


def _note_failure(task: "asyncio.Task[None]", connection: SubprotocolConnection) -> None:
    if not task.cancelled() and (error := task.exception()) is not None:
        log.error("a stream cannot be reported about, and ends", exc_info=error)
        connection.close_with(CloseCode.INTERNAL_ERROR, "the gateway failed")
