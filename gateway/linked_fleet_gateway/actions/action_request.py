"""The input of a handler: the action, its robot, and the values of the body."""

from dataclasses import dataclass, field

from pyoxigraph import NamedNode

from linked_fleet_gateway.actions.plan import Moment
from linked_fleet_gateway.base.errors import Faulty, Offline
from linked_fleet_gateway.fleet.model import Joint, RobotModel
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.resources.action_body import Body
from linked_fleet_gateway.resources.paths import part_of, robot_path


def moment_of(robot: Robot | None) -> Moment | None:
    """Return the present moment of a robot; None if it cannot be commanded now."""
    frame = None if robot is None or not robot.online else robot.frame
    if robot is None or frame is None or robot.incarnation is None or robot.limit_fault:
        return None
    return Moment(robot.incarnation, frame.monotonic_ns)


@dataclass(frozen=True)
class ActionRequest:
    """The request of an action; ``base`` is the base URL of IRIs in the body, without trailing slash."""

    base: str
    body: Body
    robot: Robot | None = None
    joint: Joint | None = None
    moment: Moment | None = None
    _parts: dict[str, tuple[str | None, str | None]] = field(default_factory=dict, compare=False)

    def of_moment(self) -> Moment:
        """Return the moment. Raises Offline or Faulty if the robot could not be commanded."""
        if self.moment is None:
            robot = self.of_robot()
            if robot.online and robot.limit_fault:
                raise Faulty(f"{robot.limit_fault}. {robot.name} moves again once they are within; it can be stopped.")
            since = "has not sent a frame yet" if robot.online else "is offline"
            raise Offline(f"Robot {robot.name} {since}; its actions answer again once it is back.")
        return self.moment

    def of_robot(self) -> Robot:
        assert self.robot is not None
        return self.robot

    def of_joint(self) -> Joint:
        assert self.joint is not None
        return self.joint

    def model(self) -> RobotModel:
        model = self.of_robot().model
        if model is None:
            raise Offline(f"Robot {self.of_robot().name} has no usable description at present.")
        return model

    def joint_at(self, iri: object) -> Joint:
        """Return the joint that an IRI in the body names, as ensured by the shape."""
        joint, _ = self._part(iri)
        assert joint is not None
        return self.model().joints[joint]

    def link_at(self, iri: object) -> str:
        _, link = self._part(iri)
        assert link is not None
        return link

    def _part(self, iri: object) -> tuple[str | None, str | None]:
        assert isinstance(iri, NamedNode)
        if iri.value not in self._parts:  # a trajectory names the same few joints thousands of times
            local = iri.value.removeprefix(self.base + robot_path(self.of_robot().name))
            self._parts[iri.value] = part_of(local, self.model())
        return self._parts[iri.value]
