"""The base of a ROS robot: where it is, by odometry and frames, and a component that drives it by velocities."""

import json
import math
import time
from typing import Any, ClassVar, NamedTuple

from linked_fleet_agent.components.call import Call
from linked_fleet_agent.components.component import value
from linked_fleet_agent.components.driving import VelocityBase
from linked_fleet_agent.components.kinds import PlanarPose
from linked_fleet_agent.planar import STANDING, DriveLimits, Pose, Velocity
from linked_fleet_agent.robots.ros2.frames import Frames, Transform, transform_of
from linked_fleet_agent.robots.ros2.graph import Outlet
from linked_fleet_agent.robots.ros2.inbox import Inbox
from linked_fleet_agent.robots.ros2.own_graph import OwnGraph
from linked_fleet_agent.robots.ros2.types import MessageType
from linked_fleet_agent.wire.messages import Base

ODOMETRY = "nav_msgs/msg/Odometry"
TWIST, STAMPED_TWIST = "geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"
USUAL_LIMITS = DriveLimits(linear=0.3, angular=0.8, linear_acceleration=0.5, angular_acceleration=1.5)
"""Limits of a base that states none: slow enough for any."""
USUAL_RADIUS_M = 0.3
STALE_S = 0.5
_ZEROS_S = 0.5
"""Time for which a base that has stopped is told to stand. Then others may drive it."""
_CORNERS = 8
_NAN3 = (math.nan, math.nan, math.nan)
UNKNOWN = Base(_NAN3, (*_NAN3, math.nan), _NAN3, _NAN3)


class Whereabouts:
    """The pose of the root link of a robot in the frame of its odometry, and on the map if it localises itself.

    Odometry gives velocities, and the pose while no frames do.
    """

    def __init__(self, root: str, odometry: Inbox | None, dynamic: Inbox, static: Inbox) -> None:
        self._root, self._odometry, self._dynamic, self._static = root, odometry, dynamic, static
        self.frames = Frames()
        self._found = dict[str, tuple[Transform, float] | None]()
        """The poses in frames by their usual names, and the times of their oldest parts, since frames came last."""

    def update(self) -> None:
        """Take the messages that have arrived."""
        static, dynamic = self._static.fetch(), self._dynamic.fetch()
        for each in static:
            self.frames.update(each, math.inf)
        for each in dynamic:
            self.frames.update(each, self._dynamic.at_s)
        if static or dynamic:
            self._found.clear()
        if self._odometry is not None:
            self._odometry.newest()

    def pose(self, now_s: float) -> Transform | None:
        """Return the pose in the frame of the odometry; None if it is not known."""
        return self._above("odom", now_s) or self._measured(now_s)

    def on_map(self, now_s: float) -> Transform | None:
        """Return the pose on the map; None if it is not known."""
        return self._above("map", now_s)

    def velocity(self, now_s: float) -> tuple[tuple[float, float, float], tuple[float, float, float]] | None:
        """Return linear and angular velocity in the frame of the base; None if they are not known."""
        said = self._fresh(now_s)
        if said is None:
            return None
        twist = said["twist"]["twist"]
        linear, angular = (tuple(float(twist[part][axis]) for axis in "xyz") for part in ("linear", "angular"))
        return (linear[0], linear[1], linear[2]), (angular[0], angular[1], angular[2])

    def reading(self, now_s: float) -> Base:
        """Return pose and velocity for a state frame; both in the frame of the odometry."""
        pose = self.pose(now_s)
        if pose is None:
            return UNKNOWN
        moving = self.velocity(now_s)
        if moving is None:
            return Base(pose.position, pose.rotation, _NAN3, _NAN3)
        turn = Transform(rotation=pose.rotation)
        linear, angular = (turn.then(Transform(each)).position for each in moving)
        return Base(pose.position, pose.rotation, linear, angular)

    def _above(self, name: str, now_s: float) -> Transform | None:
        if name not in self._found:
            self._found[name] = self._pose_in(name)
        found = self._found[name]
        return found[0] if found is not None and now_s - found[1] <= STALE_S else None

    def _pose_in(self, name: str) -> tuple[Transform, float] | None:
        root = self.frames.prefix_of(self._root) + self._root
        for frame in self.frames.above(root):
            if frame == name or frame.endswith((f"/{name}", f"_{name}")):
                return self.frames.pose(root, frame)
        return None

    def _measured(self, now_s: float) -> Transform | None:
        said = self._fresh(now_s)
        return (
            None
            if said is None
            else transform_of(said["pose"]["pose"]["position"], said["pose"]["pose"]["orientation"])
        )

    def _fresh(self, now_s: float) -> dict[str, Any] | None:
        inbox = self._odometry
        return inbox.value if inbox is not None and inbox.value and inbox.is_fresh(now_s, STALE_S) else None


class Body(NamedTuple):
    """The limits and the outline (m) of a base. ``assumed`` names what it does not state itself."""

    limits: DriveLimits
    corners: tuple[tuple[float, float], ...]
    assumed: tuple[str, ...]


async def body_of(own: OwnGraph) -> Body:
    """Ask the nodes of Nav2 for limits and outline of a base."""
    smoother = await own.parameters(f"{own.namespace}/velocity_smoother", ("max_velocity", "max_accel"))
    costmap = f"{own.namespace}/local_costmap/local_costmap"
    outline = await own.parameters(costmap, ("footprint", "robot_radius"))
    limits = limits_of(smoother.get("max_velocity"), smoother.get("max_accel"))
    corners = corners_of(outline.get("footprint"), outline.get("robot_radius"))
    assumed = tuple(what for what, known in (("its limits", limits), ("its outline", corners)) if not known)
    return Body(limits or USUAL_LIMITS, corners or _circle(USUAL_RADIUS_M), assumed)


def limits_of(velocity: object, acceleration: object) -> DriveLimits | None:
    """Return the limits that max_velocity and max_accel (x, y, theta) of Nav2's velocity smoother give, or None."""
    if not (isinstance(velocity, list) and isinstance(acceleration, list) and len(velocity) == len(acceleration) == 3):
        return None
    try:
        return DriveLimits(velocity[0], velocity[2], acceleration[0], acceleration[2], velocity[1])
    except (TypeError, ValueError):
        return None


def corners_of(footprint: object, radius: object) -> tuple[tuple[float, float], ...]:
    """Return the outline from the parameters of a costmap, counterclockwise; nothing if they give none."""
    try:
        points = [(float(x), float(y)) for x, y in json.loads(footprint)] if isinstance(footprint, str) else []
    except (TypeError, ValueError):
        points = []
    if 3 <= len(points) <= 64 and all(math.hypot(*each) < 100.0 for each in points):
        twice = sum(a[0] * b[1] - b[0] * a[1] for a, b in zip(points, [*points[1:], points[0]], strict=True))
        return tuple(points if twice > 0.0 else reversed(points)) if twice else ()
    return _circle(radius) if isinstance(radius, float) and 0.01 < radius < 100.0 else ()


def ros_base(whereabouts: Whereabouts, body: Body, outlet: Outlet, type: MessageType) -> "RosBase":
    """Return the component of a base that takes velocities on a topic."""

    class Made(RosBase, limits=body.limits):
        corners = body.corners

    if body.assumed:
        Made.__doc__ = (
            f"A base that takes velocities. It does not state {' and '.join(body.assumed)}: these are assumed."
        )
    return Made(whereabouts, outlet, type)


class RosBase(VelocityBase, limits=USUAL_LIMITS):
    """A base that takes velocities."""

    corners: ClassVar[tuple[tuple[float, float], ...]] = ()

    def __init__(self, whereabouts: Whereabouts, outlet: Outlet, type: MessageType) -> None:
        super().__init__()
        self._whereabouts, self._outlet, self._type = whereabouts, outlet, type
        self._zeros_until_s = -math.inf

    def stand(self) -> None:
        """Tell the base to stand, also if others drive it."""
        self._zeros_until_s = time.monotonic() + _ZEROS_S

    def send(self, velocity: Velocity) -> None:
        now_s = time.monotonic()
        if velocity != STANDING:
            self._zeros_until_s = now_s + _ZEROS_S
        elif now_s > self._zeros_until_s:
            return  # others may drive it
        twist = {"linear": {"x": velocity.linear, "y": velocity.lateral}, "angular": {"z": velocity.angular}}
        self._outlet.put(self._type.write({"twist": twist} if self._type.name == STAMPED_TWIST else twist))

    def measure(self, elapsed_s: float) -> tuple[Pose, Velocity]:
        now_s = time.monotonic()
        pose, moving = self._whereabouts.pose(now_s), self._whereabouts.velocity(now_s)
        at = Pose(math.nan, math.nan, math.nan) if pose is None else Pose(*pose.position[:2], pose.heading)
        return at, STANDING if moving is None else Velocity(moving[0][0], moving[0][1], moving[1][2])

    def tell(self, call: Call[Any]) -> None:
        if not self._outlet.has_subscribers:
            raise ValueError("no node takes velocities any more")
        self._known_pose()
        super().tell(call)

    @value
    def pose(self) -> PlanarPose:
        """Return where the base is in its odometry frame."""
        x, y, heading = self._known_pose()
        return PlanarPose(round(x, 4), round(y, 4), round(heading, 4))

    def _known_pose(self) -> Pose:
        if math.isnan(self.pose_now.x):
            raise ValueError(f"neither odometry nor frames have said for {STALE_S:g} s where the base is")
        return self.pose_now


def _circle(radius: float) -> tuple[tuple[float, float], ...]:
    angles = [math.tau * each / _CORNERS for each in range(_CORNERS)]
    outer = radius / math.cos(math.pi / _CORNERS)
    return tuple((round(outer * math.cos(each), 4), round(outer * math.sin(each), 4)) for each in angles)
