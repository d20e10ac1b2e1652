"""Camera pictures: one query to the robot serves all clients, and is repeated while a client follows the camera."""

import asyncio
import logging
from collections import defaultdict
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from types import TracebackType
from typing import Protocol, Self

from linked_fleet_agent.wire.codec import encode
from linked_fleet_agent.wire.messages import WIRE_VERSION, Camera, PictureFormat, PictureQuery
from linked_fleet_base.errors import AgentTimeout, Busy, Offline
from linked_fleet_gateway.api import Resource, cancel_tasks, supervised
from linked_fleet_gateway.extensions.cameras.cameras import (
    FORMATS,
    Picture,
    camera_path,
    is_in_cameras,
    read_picture,
    size_limit,
)
from linked_fleet_gateway.extensions.cameras.resources import MAX_RATE_HZ, RobotCamera
from linked_fleet_gateway.serving import Live, NoAnswer
from linked_fleet_state.robot import Robot

log = logging.getLogger(__name__)

# A robot that does not answer must not block queries to others.
MAX_UNDER_WAY, MAX_UNDER_WAY_OF_A_ROBOT = 256, 16
_PERIOD_S = 1 / MAX_RATE_HZ
_AT_ONCE, _AT_ONCE_OF_A_ROBOT = 32, 2
_TIMEOUT_S = 20.0  # the first picture of a robot starts its renderer
_AGAIN_S = 1.0

_Key = tuple[str, str, PictureFormat]


class Subscription(Protocol):
    """A subscription: a resource, the media type of its messages, and the least time between two of them."""

    @property
    def resource(self) -> str: ...

    @property
    def media_type(self) -> str: ...

    @property
    def interval_s(self) -> float: ...


class Watcher(Protocol):
    """A client that follows a resource; its subscription may change."""

    @property
    def subscription(self) -> Subscription: ...


@dataclass
class _Followed:
    """A followed camera: its subscriptions, its last pictures, and the task that refreshes them."""

    watchers: dict[Watcher, PictureFormat] = field(default_factory=dict)
    pictures: dict[str, Picture] = field(default_factory=dict)
    joined: asyncio.Event = field(default_factory=asyncio.Event)
    task: asyncio.Task[None] | None = None

    @property
    def period_s(self) -> float:
        return max(_PERIOD_S, min((each.subscription.interval_s for each in self.watchers), default=0.0))


class Pictures:
    """An async context manager; it queries robots for pictures while clients follow them."""

    def __init__(self, live: Live) -> None:
        self._live = live
        self._followed: dict[str, _Followed] = {}
        self._fresh: dict[_Key, Picture] = {}
        self._under_way: dict[_Key, asyncio.Task[Picture]] = {}
        self._room = asyncio.Semaphore(_AT_ONCE)
        self._room_of = defaultdict[str, asyncio.Semaphore](lambda: asyncio.Semaphore(_AT_ONCE_OF_A_ROBOT))

    async def __aenter__(self) -> Self:
        self._live.fan_out.on_watcher_added, self._live.fan_out.on_watcher_removed = self.follow, self.unfollow
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await cancel_tasks([each.task for each in self._followed.values() if each.task is not None])
        for asking in self._under_way.values():
            asking.cancel()

    def latest(self, robot: str, camera: str) -> dict[str, Picture]:
        """Return the last pictures of a followed camera by format; empty if no client follows it."""
        followed = self._followed.get(camera_path(robot, camera))
        return followed.pictures if followed is not None else {}

    async def get(self, source: RobotCamera, format: PictureFormat, *, renew: bool = False) -> Picture:
        """Return a recent picture, or a new one if ``renew``. Raises Offline, AgentTimeout or Busy."""
        key = (source.robot.name, source.camera.name, format)
        if not source.robot.online:
            raise Offline(f"Robot {source.robot.name!r} is offline, so its cameras give no pictures.")
        fresh = self._fresh.get(key)
        if fresh is not None and fresh.moment.incarnation == source.robot.incarnation and not renew:
            return fresh
        task = self._under_way.get(key)
        if task is None:
            of_robot = sum(name == source.robot.name for name, *_ in self._under_way)
            if len(self._under_way) >= MAX_UNDER_WAY or of_robot >= MAX_UNDER_WAY_OF_A_ROBOT:
                raise Busy("Too many pictures are being requested; try again in a moment.")
            task = self._under_way[key] = asyncio.create_task(self._fetch(key, source))
            task.add_done_callback(lambda done: self._ended(key, done))
        # other requests may wait for the same query, so a cancelled one does not end it
        return await asyncio.shield(task)

    def follow(self, watcher: Watcher) -> None:
        """Start refreshing the pictures of a subscription, if it is about a camera."""
        path, format = watcher.subscription.resource, FORMATS.get(watcher.subscription.media_type)
        if format is None or not is_in_cameras(path):
            return
        followed = self._followed.setdefault(path, _Followed())
        followed.watchers[watcher] = format
        followed.joined.set()
        if followed.task is None:
            failed = f"no pictures of {path} at present"
            followed.task = supervised(partial(self._keep, path, followed), f"watch {path}", log, failed, _AGAIN_S)

    def unfollow(self, watcher: Watcher) -> None:
        """Undo ``follow``; may be repeated."""
        path = watcher.subscription.resource
        followed = self._followed.get(path)
        if followed is None or followed.watchers.pop(watcher, None) is None or followed.watchers:
            return
        del self._followed[path]
        if followed.task is not None:
            followed.task.cancel()

    async def _keep(self, path: str, followed: _Followed) -> None:
        """Query all followed formats, report, and wait. A new follower is served without waiting for the interval."""
        loop = asyncio.get_running_loop()
        while True:
            due_s, wanted = loop.time() + _PERIOD_S, set(followed.watchers.values())
            followed.joined.clear()
            seen = await self._see(path, wanted)
            followed.pictures = {format: picture for format, picture in followed.pictures.items() if format in wanted}
            followed.pictures |= seen
            if seen:
                self._live.fan_out.mark_changed(path)
            await asyncio.sleep(max(0.0, due_s - loop.time()))
            rest_s = followed.period_s - _PERIOD_S if seen else _AGAIN_S
            with suppress(TimeoutError):
                async with asyncio.timeout(rest_s):
                    await followed.joined.wait()

    def find(self, path: str) -> RobotCamera | None:
        """Return the camera at a path, or None."""
        found = self._live.tree("").resolve(path)
        return found.remote if isinstance(found, Resource) and isinstance(found.remote, RobotCamera) else None

    async def _see(self, path: str, wanted: set[PictureFormat]) -> dict[str, Picture]:
        """Return the available pictures by format; errors of the camera or robot are ignored."""
        source, seen = self.find(path), dict[str, Picture]()
        for format in sorted(wanted) if source is not None else ():
            assert source is not None
            with suppress(Offline, AgentTimeout, Busy):
                seen[format] = await self.get(source, format, renew=True)
        return seen

    def _ended(self, key: _Key, task: asyncio.Task[Picture]) -> None:
        del self._under_way[key]
        if not task.cancelled():
            task.exception()  # retrieved even if no request waits any more

    async def _fetch(self, key: _Key, source: RobotCamera) -> Picture:
        async with self._room_of[key[0]], self._room:
            try:
                picture = await self._ask(source.robot, source.camera, key[2])
            except NoAnswer as silence:
                raise AgentTimeout(f"No picture could be fetched: {silence.reason}.") from silence
        self._fresh[key] = picture
        asyncio.get_running_loop().call_later(_PERIOD_S, self._forget, key, picture)
        return picture

    async def _ask(self, robot: Robot, camera: Camera, format: PictureFormat) -> Picture:
        """One picture, from the agent of the robot. Raises NoAnswer."""
        glance = encode(PictureQuery(version=WIRE_VERSION, camera=camera.name, format=format))

        def read(answer: bytes | str) -> tuple[Picture | None, str]:
            return read_picture(answer, camera, format, robot.incarnation)

        none = f"no agent serves pictures of robot {robot.name!r}"
        return await self._live.link.ask_agent(
            robot.name, "picture", glance, size_limit(camera), _TIMEOUT_S, read, none
        )

    def _forget(self, key: _Key, picture: Picture) -> None:
        if self._fresh.get(key) is picture:
            del self._fresh[key]
