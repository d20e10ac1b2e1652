"""Channels, services and parameters of the present fleet, and who may see them."""

import itertools
from collections.abc import Hashable, Iterable, Iterator

import msgspec

from linked_fleet_agent.wire.messages import PictureFormat
from linked_fleet_gateway.api import Core, Right, robot_path
from linked_fleet_gateway.extensions.cameras.cameras import camera_path, cameras_of
from linked_fleet_gateway.extensions.foxglove.messages import (
    FLOOR,
    OF_ROBOT,
    PART,
    PICTURES,
    SCENE,
    json_schema,
    schemas,
)
from linked_fleet_gateway.extensions.foxglove.protocol import Channel, Parameter, Service, input_schema
from linked_fleet_gateway.faces import Identity, RobotPart, named_poses, offers_at, parts_of
from linked_fleet_state.robot import Robot

SPEED = "maximumSpeedScale"
_SERVICES = ("stop", "stopAll", "assumePose")


def may_see(caller: Identity, robot: str | None) -> bool:
    return caller.has_right(Right.READ, robot) and caller.has_right(Right.SUBSCRIBE, robot)


def topic(robot: str, what: str) -> str:
    return robot_path(robot) + what


def picture_format(formats: Iterable[str]) -> PictureFormat | None:
    """Return the format for pictures of a camera, or None if it has none that Foxglove displays."""
    return "jpeg" if "jpeg" in formats else "png" if "png" in formats else None


_PART = "Foxglove"  # in faults
_MARK = "~part"
"""The end of a topic that would be that of another channel."""


def _schemas_of(part: RobotPart) -> dict[str, bytes]:
    """Return the schemas of the messages and of the inputs of a part by path."""
    streams = {path: schema for path, (schema, _) in part.streams().items()}
    inputs = {each.path: input_schema(each, "") for each in part.offers.values()}
    return {path: msgspec.json.encode(schema) for path, schema in (streams | inputs).items()}


class Catalogue:
    """The advertised channels and services. Ids are never reused, so a late message cannot refer to another channel."""

    def __init__(self, core: Core, cameras: bool) -> None:
        self.channels: dict[int, Channel] = {}
        self.services: dict[int, Service] = {}
        self.by_topic: dict[str, Channel] = {}
        self._core, self._cameras = core, cameras
        self._version: object = None
        self._next = itertools.count(1)
        self._ids: dict[Hashable, int] = {}
        self._ids_before: dict[Hashable, int] = {}
        self._schemas: dict[RobotPart, dict[str, bytes]] = {}

    def update(self) -> bool:
        """Read the fleet again. Return True if channels or services changed."""
        robots = self._robots()
        version = [(each.name, each.description, each.annotations, parts_of(each)) for each in robots]
        if version == self._version:
            return False
        self._version, self._ids_before, self._ids = version, self._ids, {}
        known, self._schemas = self._schemas, {}
        for robot in robots:
            with self._core.faults.guard(_PART, robot.name, "its components"):
                self._schemas |= {part: known.get(part) or _schemas_of(part) for part in parts_of(robot).values()}
        self.services = {each.id: each for each in self._find_services(robots)}
        self.channels = {each.id: each for each in self._find_channels(robots)}
        self.by_topic = {each.topic: each for each in self.channels.values()}
        return True

    def parameters(self, caller: Identity) -> dict[str, Parameter]:
        """Return the parameters by name; only the speed can be set."""
        found = []
        for robot in self._robots():
            if not may_see(caller, robot.name):
                continue
            with self._core.faults.guard(_PART, robot.name, "its parameters"):
                said = {"title": robot.title, "presence": robot.presence, "namedPoses": sorted(named_poses(robot))}
                found += [Parameter(topic(robot.name, what), value) for what, value in said.items()]
                found.append(Parameter(topic(robot.name, SPEED), robot.speed_scale, "float64"))
        return {each.name: each for each in found}

    def _robots(self) -> list[Robot]:
        return [each for each in self._core.robots.values() if each.model is not None]

    def _id(self, *key: Hashable) -> int:
        return self._ids.setdefault(key, self._ids_before.get(key) or next(self._next))

    def _find_channels(self, robots: Iterable[Robot]) -> Iterator[Channel]:
        schema = schemas()
        for what in (SCENE, FLOOR):
            yield Channel(self._id(what), what, schema[what], None, what)
        for robot in robots:
            with self._core.faults.guard(_PART, robot.name, "its channels"):
                yield from self._channels_of(robot)

    def _channels_of(self, robot: Robot) -> Iterator[Channel]:
        schema = schemas()
        found = {topic(robot.name, what): what for what in OF_ROBOT}
        for camera in cameras_of(robot).values() if self._cameras else ():
            if not camera.unavailable and picture_format(camera.formats) is not None:
                found[camera_path(robot.name, camera.name)] = PICTURES
        for at, what in found.items():
            yield Channel(self._id(at), at, schema[what], robot.name, what)
        for part, schemas_by_path in self._schemas_at(robot):
            for path, (_, read) in part.streams().items():
                at, said = path + _MARK if path in found else path, schemas_by_path[path]
                yield Channel(self._id(at, said), at, json_schema(path[1:], said), robot.name, PART, read)

    def _schemas_at(self, robot: Robot) -> Iterator[tuple[RobotPart, dict[str, bytes]]]:
        for part in parts_of(robot).values():
            if (found := self._schemas.get(part)) is not None:
                yield part, found

    def _find_services(self, robots: Iterable[Robot]) -> Iterator[Service]:
        offers = offers_at(None)
        for each in robots:
            with self._core.faults.guard(_PART, each.name, "its services"):
                offers += offers_at(each)
                for part, schemas_by_path in self._schemas_at(each):
                    for offer in part.offers.values():
                        yield Service(self._id(offer.path, schemas_by_path[offer.path]), offer, each.name)
        for offer in offers:
            if offer.definition.segment in _SERVICES:
                # The schema of a request has the names of poses and their joints.
                if (robot := offer.robot) is None or robot.description is None:
                    yield Service(self._id(offer.path), offer, None)
                else:
                    yield Service(self._id(offer.path, robot.description.urdf, robot.annotations), offer, robot.name)
