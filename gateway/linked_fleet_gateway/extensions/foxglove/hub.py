"""Messages for all clients, encoded once and only while somebody has subscribed.

The latest frame of each robot is polled every 6 ms, so that arriving frames cause no work. Frames that arrive faster
may be left out, as for clients that read too slowly.
"""

import asyncio
import logging
import time
from collections import defaultdict
from collections.abc import Awaitable, Callable, Iterator, Mapping, Set
from functools import partial
from typing import TYPE_CHECKING

from linked_fleet_base.errors import FleetError
from linked_fleet_gateway.api import Core, SubprotocolConnection, supervised, time_sliced
from linked_fleet_gateway.extensions.cameras.pictures import Pictures
from linked_fleet_gateway.extensions.cameras.resources import MAX_RATE_HZ
from linked_fleet_gateway.extensions.foxglove import messages, protocol
from linked_fleet_gateway.extensions.foxglove.catalogue import Catalogue, picture_format, topic
from linked_fleet_gateway.extensions.foxglove.protocol import Channel
from linked_fleet_gateway.extensions.foxglove.session import ERROR, Session
from linked_fleet_gateway.extensions.world.floor_map import FloorMap
from linked_fleet_gateway.extensions.world.placement import placement_of
from linked_fleet_gateway.extensions.world.scene import SceneObject
from linked_fleet_gateway.extensions.world.service import World
from linked_fleet_state.invocation import Invocation
from linked_fleet_state.robot import Robot

if TYPE_CHECKING:
    from linked_fleet_gateway.extensions.world.occupancy import OccupancyGrid

log = logging.getLogger(__name__)

MOST_CLIENTS = 32
TRANSFORMS_S = 1 / 30
"""Shortest time between two messages of transforms or poses of a robot; few viewers draw more often."""
_LOOK_S, _ASK_S, _SURVEY_S, _AGAIN_S = 0.006, 0.05, 0.25, 1.0
_AT_ONCE = 32  # frames in one piece
_SURVEY, _FOLLOW, _ASK = -1, -2, -3  # among the ids of channels that have a task
_Run = tuple[Callable[[], Awaitable[None]], float]


class Hub:
    """Publishes messages to all clients. Its tasks run while at least one client is connected."""

    def __init__(self, core: Core, pictures: Pictures | None, world: World | None) -> None:
        self._catalogue = Catalogue(core, pictures is not None)
        self._core, self._pictures, self._world = core, pictures, world
        self._sessions: list[Session] = []
        self._subscribers: dict[int, list[tuple[Session, int]]] = {}
        self._watched: dict[str, dict[str, Channel]] = {}
        self._shown: dict[str, bytes | None] = {}
        self._due_s = defaultdict[str, float](float)
        self._scene: tuple[Mapping[str, SceneObject], bytes] = {}, b""
        self._floor: tuple[FloorMap | None, bytes] = None, b""
        self._tasks: dict[int, asyncio.Task[None]] = {}

    async def serve(self, conversation: SubprotocolConnection, _: object) -> None:
        """Serve one client. Raises ConnectionEnded."""
        if len(self._sessions) >= MOST_CLIENTS:
            message = "Too many clients of Foxglove are connected."
            await conversation.send(protocol.text("status", level=ERROR, message=message))
            return
        session = Session(conversation, self._catalogue, self._rewatch)
        self._sessions.append(session)
        self._catalogue.update()
        self._rewatch()
        try:
            await session.run()
        finally:
            self._sessions.remove(session)
            self._rewatch()

    def _rewatch(self) -> None:
        """Recompute who is subscribed to what, and start and end tasks accordingly."""
        channels, before = self._catalogue.channels, self._subscribers
        self._subscribers, self._watched = defaultdict(list), defaultdict(dict)
        for session in self._sessions:
            session.subscribed = {id: number for id, number in session.subscribed.items() if number in channels}
            for id, number in session.subscribed.items():
                self._subscribers[number].append((session, id))
        runs: dict[int, _Run] = {_SURVEY: (self._survey, _SURVEY_S)} if self._sessions else {}
        for channel in map(channels.__getitem__, self._subscribers):
            if channel.robot is not None and channel.what in messages.FRAMES:
                self._watched[channel.robot][channel.what] = channel
                if any(each not in before.get(channel.id, ()) for each in self._subscribers[channel.id]):
                    # Who subscribes now has not got the present frame, which may be the last one.
                    self._shown.pop(channel.robot, None)
                    self._due_s.pop(channel.robot, None)
                runs[_FOLLOW] = self._follow, _LOOK_S
            elif channel.what == messages.PICTURES and self._pictures is not None:
                runs[channel.id] = partial(self._picture, self._pictures, channel), 1 / MAX_RATE_HZ
            elif channel.what == messages.PART:
                runs[_ASK] = self._ask_parts, _ASK_S
        for id in self._tasks.keys() - runs.keys():
            self._tasks.pop(id).cancel()
        for id in runs.keys() - self._tasks.keys():
            run, pause_s = runs[id]
            self._tasks[id] = supervised(run, "Foxglove", log, "Foxglove may show outdated values", pause_s)

    def _publish(self, channel: Channel | None, content: bytes) -> None:
        for session, id in self._subscribers.get(channel.id, ()) if channel is not None else ():
            session.conversation.try_send(protocol.data(id, time.time_ns(), content))

    async def _follow(self) -> None:
        """Poll for new frames, and send those of several robots together."""
        pieces = defaultdict[Session, list[bytes]](list)
        async for name, channels in time_sliced(list(self._watched.items())):
            robot = self._core.robots.get(name)
            if robot is not None:
                robot.adopt_latest_frame()
                self._show(robot, channels, pieces)
            for session in [each for each, waiting in pieces.items() if len(waiting) > _AT_ONCE]:
                session.conversation.try_send(b"".join(pieces.pop(session)))
        for session, waiting in pieces.items():
            session.conversation.try_send(b"".join(waiting))

    def _show(self, robot: Robot, channels: Mapping[str, Channel], pieces: dict[Session, list[bytes]]) -> None:
        payload, now_ns = robot.payload, time.time_ns()
        if payload is self._shown.get(robot.name):
            return
        self._shown[robot.name] = payload
        for what, content in self._contents(robot, channels.keys()):
            for session, id in self._subscribers.get(channels[what].id, ()):
                pieces[session].append(protocol.data(id, now_ns, content))

    def _contents(self, robot: Robot, wanted: Set[str]) -> Iterator[tuple[str, bytes]]:
        """Yield messages of the present frame by channel; transforms and poses only every ``TRANSFORMS_S``."""
        state, now_s = robot.frame, time.monotonic()
        if state is None or robot.description is None:
            return
        if messages.STATES in wanted:
            yield messages.STATES, messages.joint_states(robot.description.joints, state)
        if now_s < self._due_s[robot.name] or wanted <= {messages.STATES}:
            return
        self._due_s[robot.name] = max(self._due_s[robot.name] + TRANSFORMS_S, now_s)
        placement = placement_of(robot)
        poses, frame = messages.link_poses(robot, placement), messages.frame_of(robot.name, placement)
        if messages.TRANSFORMS in wanted and poses:
            yield messages.TRANSFORMS, messages.transforms(robot.name, poses, frame, state.wall_ns)
        if messages.POSE in wanted and poses:
            yield messages.POSE, messages.pose(next(iter(poses.values())), frame, state.wall_ns)

    async def _survey(self) -> None:
        """Poll for rarely changing data: channels, the objects of the world, and the presence of robots."""
        if self._catalogue.update():
            self._rewatch()
        for session in self._sessions:
            session.news.set()
        if any(self._catalogue.channels[number].what == messages.FLOOR for number in self._subscribers):
            await self._draw_floor()
        for number in list(self._subscribers):
            channel = self._catalogue.channels[number]
            robot = self._core.robots.get(channel.robot or "")
            if channel.what == messages.SCENE:
                self._tell(channel, self._scene_content())
            elif channel.what == messages.FLOOR:
                self._tell(channel, self._floor[1])
            elif channel.what == messages.LOG and robot is not None:
                said = " ".join(filter(None, (robot.presence, robot.fault)))
                at_ns = robot.last_seen_ns if robot.presence == "offline" else robot.heard_ns
                self._tell(channel, messages.log(robot.name, said, robot.presence != "online", at_ns or 0))

    async def _ask_parts(self) -> None:
        """Poll the parts whose channels somebody has subscribed to."""
        async for number in time_sliced(list(self._subscribers)):
            channel = self._catalogue.channels.get(number)
            if channel is not None and channel.read is not None:
                self._tell(channel, channel.read())

    def _tell(self, channel: Channel, state: bytes) -> None:
        """Send a state to each subscriber that has not received it yet, once it has room."""
        for session, id in self._subscribers[channel.id]:
            known = session.told.get(channel.id) == state
            if not known and session.conversation.try_send(protocol.data(id, time.time_ns(), state)):
                session.told[channel.id] = state

    def _scene_content(self) -> bytes:
        objects = self._objects()
        if not self._scene[1] or self._scene[0] != objects:
            self._scene = dict(objects), messages.scene(objects, time.time_ns())
        return self._scene[1]

    def _objects(self) -> dict[str, SceneObject]:
        """Return the objects of the world, without what a robot holds that not all clients may know of."""
        known = self._world.objects.known if self._world is not None else {}
        return {id: each for id, each in known.items() if each.held is None or self._all_see(each.held.robot)}

    def _all_see(self, robot: str) -> bool:
        return all(session.sees(robot) for session in self._sessions)

    async def _draw_floor(self) -> None:
        """Encode the map of the floor if it has changed."""
        found = self._world.floor if self._world is not None else None
        if not self._floor[1] or self._floor[0] is not found:
            grid = await self._world.occupancy() if self._world is not None else None
            self._floor = found, await asyncio.to_thread(_grid_message, grid)

    def hear(self, invocation: Invocation) -> None:
        """Send a changed invocation as an event of each of its robots."""
        for robot in (invocation.robots or (invocation.robot,)) if self._sessions else ():
            channel = self._catalogue.by_topic.get(topic(robot, messages.EVENTS))
            if channel is not None and channel.id in self._subscribers:
                self._publish(channel, messages.event(robot, invocation, time.time_ns()))

    async def _picture(self, pictures: Pictures, channel: Channel) -> None:
        """Send one picture of a camera."""
        source = pictures.find(channel.topic)
        format = None if source is None else picture_format(source.camera.formats)
        if source is None or format is None:
            return
        try:
            found = await pictures.get(source, format, renew=True)
        except FleetError as error:
            log.debug("no picture of %s: %s", channel.topic, error)
            await asyncio.sleep(_AGAIN_S)
            return
        frame = f"{source.robot.name}/{source.camera.link}"
        self._publish(channel, messages.picture(frame, found.content, format, found.moment.wall_ns))


def _grid_message(grid: "OccupancyGrid | None") -> bytes:
    from linked_fleet_gateway.extensions.foxglove.floor import floor_grid  # imports numpy

    return floor_grid(grid, time.time_ns())
