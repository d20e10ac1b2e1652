"""Hand-over of presence, frames, progress and other messages from the session's threads to the event loop."""

import logging
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from itertools import chain
from typing import Literal

from linked_fleet_agent.wire.codec import WireError, decode
from linked_fleet_agent.wire.components import without_unusable_parts
from linked_fleet_agent.wire.keys import Keys, RobotKey
from linked_fleet_agent.wire.messages import Condition, Progress
from linked_fleet_link.discovery import Discovery
from linked_fleet_link.transport import Session
from linked_fleet_runtime.background import TURN_S, Turns
from linked_fleet_state.answers import RejectedMessages
from linked_fleet_state.events import Batch, Conditioned, Event, Framed, Frames, Inbox, Payload

_log = logging.getLogger(__name__)

MAX_STATE_BYTES = MAX_CONDITION_BYTES = MAX_EVENT_BYTES = 65_536
MAX_PROGRESS_BYTES = MAX_VALUES_BYTES = 320 * 1024
"""A result, or all values of a robot, and what is around them."""
OfComponents = Literal["values", "event"]
Hear = Callable[[str, bytes], None]
"""Gets the name of a robot and a message that is not decoded. Raises WireError, which is counted."""


class Incoming:
    """Calls ``discovery``, ``on_events``, ``on_progress`` and ``listeners`` on the event loop, in turns of a few
    milliseconds.

    Frames that ``frames`` stores cause no event.
    """

    def __init__(
        self,
        keys: Keys,
        frames: Frames,
        discovery: Discovery,
        on_events: Callable[[list[Event]], None],
        on_progress: Callable[[str, Progress], None],
        listeners: Mapping[OfComponents, Hear],
    ) -> None:
        self._keys = keys
        self._frames = frames
        self._discovery = discovery
        self._on_events = on_events
        self._on_progress = on_progress
        self._listeners = listeners
        self._own: Mapping[str, Hear] = {
            "state": self._framed,
            "condition": self._conditioned,
            "progress": self._progressed,
        }
        self._inbox = Inbox(Turns(self._work).waker())
        self._steps: Iterator[Callable[[], None]] = iter(())
        self.complaints = RejectedMessages(_log)

    async def declare(self, session: Session) -> None:
        """Subscribe to frames first and to tokens last, so that no frame of a visible robot is missed."""
        await session.subscribe_frames(self._keys.all_states, MAX_STATE_BYTES, self._hear_state)
        await session.subscribe(self._keys.all_progress, MAX_PROGRESS_BYTES, self._inbox.put_progress)
        for kind, most in (("values", MAX_VALUES_BYTES), ("event", MAX_EVENT_BYTES)):
            if kind in self._listeners:
                await session.subscribe(self._keys.all_of_kind(kind), most, self._inbox.put_of_components)
        await session.subscribe(self._keys.all_conditions, MAX_CONDITION_BYTES, self._inbox.put_state)
        await session.subscribe_tokens(self._keys.all_presence, self._inbox.put_presence)

    def close(self) -> None:
        """Stop all reports."""
        self._inbox.close()
        self._steps = iter(())

    def parse(self, key: str) -> RobotKey | None:
        try:
            return self._keys.parse(key)
        except ValueError as error:
            self.complaints.add(key, error)
            return None

    # -- in threads -------------------------------------------------------------------------------------------------

    def _hear_state(self, key: str, payload: Payload) -> None:
        if isinstance(payload, int) or not self._frames.put(key, payload, time.time_ns()):
            self._inbox.put_state(key, payload)

    # -- in the event loop ------------------------------------------------------------------------------------------

    def _work(self, begin: float) -> bool:
        """Process messages, new ones after all earlier ones."""
        while True:
            for step in self._steps:
                step()  # an error in it is logged by the event loop, and ends neither the batch nor this object's work
                if time.perf_counter() - begin > TURN_S:
                    return True
            batch = self._inbox.take()
            if batch is None:
                return False
            self._steps = self._tell(batch)

    def _tell(self, batch: Batch) -> Iterator[Callable[[], None]]:
        """Yield a step for each message; presence precedes the messages of the same batch."""
        for key, present in batch.presence.items():
            yield partial(self._token, key, present)
        if batch.presence_lost:
            yield self._discovery.relist
        for key, payload in chain(batch.states.items(), batch.progress, batch.of_components):
            yield partial(self._heard, key, payload)

    def _token(self, key: str, present: bool) -> None:
        robot = self.parse(key)
        if robot is not None and robot.incarnation is not None:
            self._on_events(self._discovery.apply_token((robot.robot, robot.incarnation), present))

    def _heard(self, key: str, payload: Payload) -> None:
        robot = self.parse(key)
        if robot is None:
            return
        if not isinstance(payload, bytes):
            self.complaints.add(robot.robot, f"a payload of {payload!r} bytes, which is too large")
            return
        hear = self._own.get(robot.kind) or self._listeners[robot.kind]  # type: ignore[index]
        try:
            hear(robot.robot, payload)
        except WireError as error:
            self.complaints.add(robot.robot, error)

    def _framed(self, robot: str, payload: bytes) -> None:
        self._discovery.record_frame(robot)
        self._on_events([Framed(robot, payload)])

    def _conditioned(self, robot: str, payload: bytes) -> None:
        self._on_events([Conditioned(robot, decode(payload, Condition))])

    def _progressed(self, robot: str, payload: bytes) -> None:
        progress, problem = without_unusable_parts(decode(payload, Progress))
        if problem:  # the state counts nevertheless
            self.complaints.add(robot, problem)
        self._on_progress(robot, progress)
