"""The component by which joints are jogged: the agent adds it to each robot whose joints take setpoints."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from linked_fleet_agent.components.call import Call
from linked_fleet_agent.components.component import Component, action, value
from linked_fleet_agent.components.declaration import Declared
from linked_fleet_agent.components.kinds import Mode
from linked_fleet_agent.components.schemas import unit
from linked_fleet_agent.components.velocity_runs import VelocityRuns
from linked_fleet_agent.motion import Motions
from linked_fleet_agent.robot import JointFacts
from linked_fleet_agent.urdf.cruise import RAMP_S, cruise_of
from linked_fleet_agent.wire.components import StreamLimits
from linked_fleet_agent.wire.kinds import LF
from linked_fleet_agent.wire.schema import MAX_MEMBERS

NAME = "jogging"
MOST_S, USUAL_S = 1.0, 0.5
"""Time that one request of velocities holds, at most and by default."""
STOP_S = RAMP_S + 0.5
_DIGITS = 4
_Duration = Annotated[float, unit("SEC"), Meta(ge=0, le=MOST_S, title="How long the velocities hold")]
_Reason = Annotated[str, Meta(max_length=1024, title="Why it is slower than asked for")]


class StuckError(Exception):
    """Joints cannot be jogged on; the message says why."""


class Jogging(VelocityRuns, Component, kind=LF + "Jogging", rename="camel", blocking=False, rate_hz=20):
    """Moves joints at velocities for as long as somebody wants them. Joints slow down before their limits."""

    name = NAME

    def __init__(self, joints: Sequence[str], motions: Motions, speed_share: Callable[[], float]) -> None:
        super().__init__()
        self._joints, self._motions, self._speed_share = tuple(joints), motions, speed_share
        self._until_s = 0.0

    @property
    def standing(self) -> bool:
        return not self._motions.jog.wanted and self._motions.stands(self._joints)

    def request(self, given: Mapping[str, Any], until_s: float) -> None:
        said = msgspec.to_builtins(given["velocities"])
        share = self._speed_share()
        self._motions.jog.request({name: share * said.get(name, 0.0) for name in self._joints})
        self._until_s = until_s

    def brake(self) -> None:
        self._motions.jog.release()

    def tell(self, call: Call[Any]) -> None:
        if self._motions.jog.failed:
            raise StuckError(self._motions.jog.failed)

    @value
    def limited_because(self) -> _Reason:
        """Tell which joint slows all down, because it is near its limit or lags behind; empty if none does."""
        return self._motions.jog.limited

    def on_tick(self, now_s: float) -> None:
        if now_s >= self._until_s:
            self.brake()
        self.note_tick(now_s)

    def on_halt(self) -> None:
        self.brake()

    async def jog(self, call: Call[None], velocities: Any, duration_s: float) -> None:
        """Carry out a run. It begins from rest, or takes over the speed of an earlier one that is still moving."""
        self._motions.begin_jog(self._joints)
        await self.hold_for(call, {"velocities": velocities}, duration_s)


def joints_to_jog(joints: Iterable[JointFacts], declared: Iterable[Declared]) -> list[JointFacts]:
    """Return the joints that take setpoints, but for the fingers of grippers. No more than a schema has members."""
    grippers = [each.said for each in declared if each.said.semantic_type == LF + "Gripper"]
    fingers = {joint for each in grippers for action in each.actions.values() for joint in action.moves}
    found = [each for each in joints if not (each.passive or each.mimics or each.refusal or each.name in fingers)]
    return found[:MAX_MEMBERS]


def jogging_of(joints: Sequence[JointFacts], motions: Motions, parts: Sequence[Component]) -> Jogging:
    """Return the component for these joints of a robot with these other components."""
    modes = [each for each in parts if isinstance(each, Mode) and not each.blocking]
    members = {"accelerations": _accelerations(joints, motions), "jog_joints": _jog_joints(joints)}
    jogging: type[Jogging] = type("JoggingOfRobot", (Jogging,), {"__doc__": Jogging.__doc__, **members})
    return jogging(
        [each.name for each in joints], motions, lambda: min((each.speed_scale for each in modes), default=1.0)
    )


def _accelerations(joints: Sequence[JointFacts], motions: Motions) -> Any:
    """Return the value, with a member for each joint."""
    given = _by_joint("Accelerations", joints, _acceleration)
    said = msgspec.convert({each.name: motions.jog.accelerations[each.name] for each in joints}, given)

    def accelerations(self: Jogging) -> Any:
        """Return by how much each joint accelerates and brakes."""
        return said

    accelerations.__annotations__["return"] = given
    return value(accelerations)


def _jog_joints(joints: Sequence[JointFacts]) -> Any:
    """Return the action, with a velocity for each joint in its input."""
    given = _by_joint("Velocities", joints, _velocity)
    standing = given()

    async def jog_joints(
        self: Jogging, call: Call[None], velocities: Any = standing, duration: _Duration = USUAL_S
    ) -> None:
        """Move joints with these velocities for a short time, then brake. Joints without one stand.

        The samples of a stream hold for its time of silence, whatever their duration.
        """
        await self.jog(call, velocities, duration)

    jog_joints.__annotations__["velocities"] = given
    moves, longest_s = [each.name for each in joints], MOST_S + STOP_S
    return action(moves=moves, duration_s=longest_s, stop_s=STOP_S, takes_over=True, stream=StreamLimits())(jog_joints)


def _by_joint(title: str, joints: Sequence[JointFacts], type_of: Callable[[JointFacts], Any]) -> Any:
    """Return a structure with a number for each joint. Its attributes are numbered, since joints have any names."""
    fields = [(f"joint_{index}", type_of(each), 0.0) for index, each in enumerate(joints)]
    names = {attribute: each.name for (attribute, *_), each in zip(fields, joints, strict=True)}
    return msgspec.defstruct(title, fields, rename=names, omit_defaults=True, forbid_unknown_fields=True, frozen=True)


def _velocity(joint: JointFacts) -> Any:
    most = int(cruise_of(joint) * 10**_DIGITS) / 10**_DIGITS
    return Annotated[float, unit("M-PER-SEC" if joint.linear else "RAD-PER-SEC"), Meta(ge=-most, le=most)]


def _acceleration(joint: JointFacts) -> Any:
    return Annotated[float, unit("M-PER-SEC2" if joint.linear else "RAD-PER-SEC2")]
