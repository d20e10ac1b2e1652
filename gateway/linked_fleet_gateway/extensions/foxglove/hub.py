"""Messages that all clients get: encoded once for all of them, and only while somebody has subscribed to it.

The latest frame of a robot is looked at every 6 ms. So a frame costs nothing but its encoding, and one that comes
sooner after another may be left out, as it is for a client that does not read fast enough.
"""

import asyncio
import logging
import time
from collections import defaultdict
from collections.abc import Awaitable, Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import cast

from linked_fleet_agent.wire.codec import WireError
from linked_fleet_gateway.base.errors import FleetError
from linked_fleet_gateway.extensions.cameras.pictures import Pictures
from linked_fleet_gateway.extensions.cameras.resources import MAX_RATE_HZ, RobotCamera
from linked_fleet_gateway.extensions.foxglove import messages, protocol
from linked_fleet_gateway.extensions.foxglove.catalogue import SCENE, Catalogue, picture_format, topic
from linked_fleet_gateway.extensions.foxglove.messages import EVENTS, FRAMES, LOG, FrameEncoder
from linked_fleet_gateway.extensions.foxglove.protocol import Channel
from linked_fleet_gateway.extensions.foxglove.session import ERROR, Session
from linked_fleet_gateway.extensions.foxglove.template import clamped
from linked_fleet_gateway.extensions.history.track import joints_of
from linked_fleet_gateway.extensions.world.scene import SceneObject
from linked_fleet_gateway.fleet.cameras import cameras_of
from linked_fleet_gateway.fleet.invocation import Invocation
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.http.conversation import Conversation
from linked_fleet_gateway.resources.placement import placement_of
from linked_fleet_gateway.runtime.background import supervised
from linked_fleet_gateway.runtime.time_slices import sliced
from linked_fleet_gateway.subscriptions.live import Live

log = logging.getLogger(__name__)

MOST_CLIENTS = 32
TRANSFORMS_S = 1 / 30
"""The shortest time between two messages of transforms or poses of a robot: few viewers draw more often."""
_LOOK_S, _SURVEY_S, _AGAIN_S = 0.006, 0.25, 1.0
_AT_ONCE = 32  # frames in one piece
_SURVEY, _FOLLOW = -1, -2  # among the ids of channels that have a task
_PICTURES = "foxglove.CompressedImage"
_Run = tuple[Callable[[], Awaitable[None]], float]


class Hub:
    """Its tasks run while somebody is connected."""

    def __init__(self, live: Live, pictures: Pictures | None) -> None:
        self._catalogue = Catalogue(live, pictures is not None)
        self._live, self._pictures = live, pictures
        self._sessions: list[Session] = []
        live.add_invocation_listener(self._hear)
        self._subscribers: dict[int, list[tuple[Session, int]]] = {}
        self._watched: dict[str, dict[str, Channel]] = {}
        self._encoders: dict[str, FrameEncoder] = {}
        self._scene: tuple[Mapping[str, SceneObject], bytes] = {}, b""
        self._tasks: dict[int, asyncio.Task[None]] = {}

    async def speak(self, conversation: Conversation, _: object) -> None:
        """Serve one client. Raises Ended."""
        if len(self._sessions) >= MOST_CLIENTS:
            message = "Too many clients of Foxglove are connected."
            await conversation.send(protocol.text("status", level=ERROR, message=message))
            return
        session = Session(conversation, self._catalogue, self._live.fleet.robots, self._rewatch)
        with self._joined(session):
            await session.run()

    @contextmanager
    def _joined(self, session: Session) -> Iterator[None]:
        self._sessions.append(session)
        self._catalogue.update()
        self._rewatch()
        try:
            yield
        finally:
            self._sessions.remove(session)
            self._rewatch()

    def _rewatch(self) -> None:
        """Do what is subscribed to now, and nothing else."""
        channels = self._catalogue.channels
        self._subscribers, self._watched = defaultdict(list), defaultdict(dict)
        for session in self._sessions:
            session.subscribed = {id: number for id, number in session.subscribed.items() if number in channels}
            for id, number in session.subscribed.items():
                self._subscribers[number].append((session, id))
        runs: dict[int, _Run] = {_SURVEY: (self._survey, _SURVEY_S)} if self._sessions else {}
        for channel in map(channels.__getitem__, self._subscribers):
            if channel.robot is not None and channel.what in FRAMES:
                self._watched[channel.robot][channel.what] = channel
                runs[_FOLLOW] = self._follow, _LOOK_S
            elif channel.schema.name == _PICTURES:
                runs[channel.id] = partial(self._picture, channel), 1 / MAX_RATE_HZ
        for id in self._tasks.keys() - runs.keys():
            self._tasks.pop(id).cancel()
        for id in runs.keys() - self._tasks.keys():
            run, pause_s = runs[id]
            self._tasks[id] = supervised(run, "Foxglove", log, "Foxglove may show what was", pause_s)

    def _publish(self, channel: Channel | None, content: bytes) -> None:
        for session, id in self._subscribers.get(channel.id, ()) if channel is not None else ():
            session.conversation.offer(protocol.data(id, _now_ns(), content))

    async def _follow(self) -> None:
        """Look for new frames, and send those of several robots at once."""
        pieces = defaultdict[Session, list[bytes]](list)
        async for name, channels in sliced(list(self._watched.items())):
            robot = self._live.fleet.robots.get(name)
            if robot is not None:
                robot.look()
                self._show(robot, channels, pieces)
            for session in [each for each, waiting in pieces.items() if len(waiting) > _AT_ONCE]:
                session.conversation.offer(b"".join(pieces.pop(session)))
        for session, waiting in pieces.items():
            session.conversation.offer(b"".join(waiting))

    def _show(self, robot: Robot, channels: Mapping[str, Channel], pieces: dict[Session, list[bytes]]) -> None:
        frame, encoder = robot.payload, self._encoders.get(robot.name)
        if encoder is None or encoder.about is not robot.description:
            joints = joints_of(robot)
            if joints is None:
                return
            encoder = self._encoders[robot.name] = FrameEncoder(robot.name, joints, robot.description)
        if frame is None or frame is encoder.frame:
            return
        encoder.frame = frame
        try:
            contents = encoder.contents(frame, placement_of(robot), TRANSFORMS_S, channels.keys())
        except WireError as error:
            log.debug("a frame of %s is not shown: %s", robot.name, error)
            return
        now_ns = _now_ns()
        for what, content in contents.items():
            for session, id in self._subscribers.get(channels[what].id, ()):
                pieces[session].append(protocol.data(id, now_ns, content))

    async def _survey(self) -> None:
        """Look for what changes seldom."""
        if self._catalogue.update():
            self._rewatch()
        for session in self._sessions:
            session.news.set()
        for number in list(self._subscribers):
            channel = self._catalogue.channels[number]
            robot = self._live.fleet.robots.get(channel.robot or "")
            if channel.what == SCENE:
                self._tell(channel, self._scene_content())
            elif channel.what == LOG and robot is not None:
                said = " ".join(filter(None, (robot.presence, robot.fault)))
                at_ns = robot.last_seen_ns if robot.presence == "offline" else robot.heard_ns
                self._tell(channel, messages.log(robot.name, said, robot.presence != "online", at_ns or 0))

    def _tell(self, channel: Channel, state: bytes) -> None:
        """Send a state to each subscriber that has not got it yet, as soon as that reads."""
        for session, id in self._subscribers[channel.id]:
            known = session.told.get(channel.id) == state
            if not known and session.conversation.offer(protocol.data(id, _now_ns(), state)):
                session.told[channel.id] = state

    def _scene_content(self) -> bytes:
        objects = cast(Mapping[str, SceneObject], self._live.objects())
        if not self._scene[1] or self._scene[0] != objects:
            self._scene = dict(objects), messages.scene(objects, _now_ns())
        return self._scene[1]

    def _hear(self, invocation: Invocation) -> None:
        """Show an invocation that changed as an event of each of its robots."""
        for robot in (invocation.robots or (invocation.robot,)) if self._sessions else ():
            channel = self._catalogue.by_topic.get(topic(robot, EVENTS))
            if channel is not None and channel.id in self._subscribers:
                self._publish(channel, messages.event(robot, invocation, _now_ns()))

    async def _picture(self, channel: Channel) -> None:
        """Show one picture of a camera."""
        robot = self._live.fleet.robots.get(channel.robot or "")
        camera = None if robot is None else cameras_of(robot).get(channel.what)
        format = None if camera is None else picture_format(camera.formats)
        if robot is None or camera is None or format is None or self._pictures is None:
            await asyncio.sleep(_AGAIN_S)
            return
        try:
            found = await self._pictures.get(RobotCamera(robot, camera), format, anew=True)
        except FleetError as error:
            log.debug("no picture of %s: %s", channel.topic, error)
            await asyncio.sleep(_AGAIN_S)
            return
        frame_id = f"{robot.name}/{camera.link}"
        self._publish(channel, messages.picture(frame_id, found.content, format, found.moment.wall_ns))


def _now_ns() -> int:
    return clamped(time.time_ns())
