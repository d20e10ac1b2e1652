"""Channels, services and parameters of the fleet as it is at present, and who may see them."""

import itertools
from collections.abc import Hashable, Iterable, Iterator
from typing import TYPE_CHECKING

from linked_fleet_agent.wire.messages import PictureFormat
from linked_fleet_gateway.base.lazy_imports import Lazily
from linked_fleet_gateway.extensions.foxglove.messages import schemas
from linked_fleet_gateway.extensions.foxglove.protocol import Channel, Parameter, Service
from linked_fleet_gateway.fleet.cameras import cameras_of
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.identity.rights import Identity, Right
from linked_fleet_gateway.resources.action_offer import Offer, fleet_offers, robot_offers
from linked_fleet_gateway.resources.named_poses import poses
from linked_fleet_gateway.resources.paths import camera_path, robot_path
from linked_fleet_gateway.subscriptions.live import Live

if TYPE_CHECKING:
    from foxglove import messages as fox
else:
    fox = Lazily("foxglove.messages", "foxglove")

SCENE = "/world/objects"
SPEED = "maximumSpeedScale"
_STOPS, _MOVES = ("stop", "stopAll"), "assumePose"


def may_see(caller: Identity, robot: str | None) -> bool:
    return caller.may(Right.READ, robot) and caller.may(Right.SUBSCRIBE, robot)


def topic(robot: str, what: str) -> str:
    return robot_path(robot) + what


def picture_format(formats: Iterable[str]) -> PictureFormat | None:
    """The format in which pictures of a camera are shown, if it has any that Foxglove shows."""
    return "jpeg" if "jpeg" in formats else "png" if "png" in formats else None


def parameters(robot: Robot) -> Iterator[Parameter]:
    """The parameters of a robot, of which that of its speed can be set."""
    yield Parameter(topic(robot.name, "title"), robot.title)
    yield Parameter(topic(robot.name, "presence"), robot.presence)
    yield Parameter(topic(robot.name, "namedPoses"), sorted(poses(robot)))
    yield Parameter(topic(robot.name, SPEED), robot.speed_scale, "float64")


class Catalogue:
    """No id is used twice, so that a message of a client is never taken for one about something else."""

    def __init__(self, live: Live, cameras: bool) -> None:
        self.channels: dict[int, Channel] = {}
        self.services: dict[int, Service] = {}
        self.by_topic: dict[str, Channel] = {}
        self._live, self._cameras = live, cameras
        self._version: object = None
        self._next = itertools.count(1)
        self._ids: dict[Hashable, int] = {}

    def update(self) -> bool:
        """Look at the fleet anew; whether there is something else now."""
        robots = [each for each in self._live.fleet.robots.values() if each.model is not None]
        version = [(each.name, each.description, each.annotations) for each in robots]
        if version == self._version:
            return False
        self._version, known, self._ids = version, self._ids, {}
        offers = [*fleet_offers(), *(offer for each in robots for offer in robot_offers(each))]
        found = [self._service(known, each) for each in offers]
        self.services = {each.id: each for each in found if each is not None}
        self.by_topic = {each.topic: each for each in self._channels(known, robots)}
        self.channels = {each.id: each for each in self.by_topic.values()}
        return True

    def _id(self, known: dict[Hashable, int], key: Hashable) -> int:
        return self._ids.setdefault(key, known.get(key) or next(self._next))

    def _channels(self, known: dict[Hashable, int], robots: Iterable[Robot]) -> Iterator[Channel]:
        known_schemas = schemas()
        yield Channel(self._id(known, SCENE), SCENE, fox.SceneUpdate.get_schema(), None, SCENE)
        for robot in robots:
            for what, schema in known_schemas.items():
                at = topic(robot.name, what)
                yield Channel(self._id(known, at), at, schema, robot.name, what)
            for camera in cameras_of(robot).values() if self._cameras else ():
                if not camera.unavailable and picture_format(camera.formats) is not None:
                    at, schema = camera_path(robot.name, camera.name), fox.CompressedImage.get_schema()
                    yield Channel(self._id(known, at), at, schema, robot.name, camera.name)

    def _service(self, known: dict[Hashable, int], offer: Offer) -> Service | None:
        segment, robot = offer.definition.segment, offer.robot
        stops, named = segment in _STOPS, () if robot is None else tuple(sorted(poses(robot)))
        if not stops and segment != _MOVES:
            return None
        request: dict[str, object] = {"type": "object"}
        if not stops:
            speed = {"type": "number", "exclusiveMinimum": 0, "maximum": 1}
            request |= {"properties": {"pose": {"enum": named}, "speedScale": speed}, "required": ["pose"]}
        id = self._id(known, (offer.path, named))
        return Service(id, offer.path, None if robot is None else robot.name, stops, request)
