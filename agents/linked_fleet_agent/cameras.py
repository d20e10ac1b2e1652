"""Camera pictures on request, each of a published state frame. Independent of Zenoh."""

import math
import time
from collections.abc import Sequence

from linked_fleet_agent.robot import CameraRobot, PictureError, Reading, Robot
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.codec import WireError
from linked_fleet_agent.wire.messages import Camera, PictureQuery, State
from linked_fleet_agent.wire.pictures import PictureHeader, encode_picture

PERIOD_S = 0.05


class Cameras:
    """The cameras of a robot.

    ``take`` is called in a thread, one call at a time. It waits to keep ``PERIOD_S`` between two pictures.
    """

    def __init__(self, robot: Robot, cameras: Sequence[Camera]) -> None:
        self.offers = tuple(cameras) if isinstance(robot, CameraRobot) else ()
        self._robot = robot
        self._cameras = {camera.name: camera for camera in self.offers}
        self._due_s = 0.0

    def take(self, question: bytes, shown: State | None) -> bytes:
        """Return the reply: a picture of the robot in state ``shown`` (None if it could not be read).

        Raises PictureError.
        """
        try:
            asked = codec.decode(question, PictureQuery)
        except WireError as error:
            raise PictureError(f"this is no question for a picture: {error}") from error
        camera = self._cameras.get(asked.camera)
        if camera is None or asked.format not in camera.formats:
            known = ", ".join(f"{each.name} ({', '.join(each.formats)})" for each in self.offers) or "none"
            why = camera.unavailable if camera is not None and camera.unavailable else f"there are {known}"
            raise PictureError(f"no {asked.format} picture of camera {asked.camera!r} can be had: {why}")
        if shown is None or not all(map(math.isfinite, shown.positions)):
            raise PictureError("the robot cannot be measured now, so nobody knows what its camera sees")
        time.sleep(max(0.0, self._due_s - time.monotonic()))
        self._due_s = time.monotonic() + PERIOD_S
        assert isinstance(self._robot, CameraRobot)
        reading = Reading(shown.positions, shown.velocities, shown.efforts, shown.base)
        content = self._robot.picture(camera, asked.format, reading)
        moment = PictureHeader(
            camera.height, camera.width, shown.incarnation, shown.sequence, shown.monotonic_ns, shown.wall_ns,
            camera.near_m, camera.far_m,
        )  # fmt: skip
        try:
            return encode_picture(asked.format, moment, content)
        except WireError as error:
            raise PictureError(str(error)) from error
