"""A driver for robots that only their components move: a gripper, a switch box, a cell with a program of its own."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from xml.sax.saxutils import quoteattr

from linked_fleet_agent.components.component import Component
from linked_fleet_agent.robot import Facts, Reading
from linked_fleet_agent.urdf import joints_of
from linked_fleet_agent.wire.messages import Base


class RobotOfComponents:
    """A robot whose joints, if it has any, take no commands but the actions of its ``components``.

    ``urdf`` is a single link by default. ``measure`` returns the positions of its joints in their order (rad or m),
    ``measure_base`` pose and twist of a robot that drives, in its odometry frame.
    """

    def __init__(
        self,
        title: str,
        *components: Component,
        urdf: str = "",
        measure: Callable[[], Sequence[float]] = tuple,
        measure_base: Callable[[], Base] | None = None,
    ) -> None:
        urdf = urdf or f'<robot name={quoteattr(title)}><link name="base"/></robot>'
        joints = tuple(replace(joint, passive=True) for joint in joints_of(urdf))
        self._facts = Facts(title, urdf, joints, floating=measure_base is not None)
        self._components, self._measure, self._measure_base = components, measure, measure_base
        self._unknown = (math.nan,) * len(joints)

    def describe(self) -> Facts:
        return self._facts

    def components(self) -> Sequence[Component]:
        return self._components

    def read(self, now_s: float) -> Reading:
        base = None if self._measure_base is None else self._measure_base()
        return Reading(tuple(self._measure()), self._unknown, self._unknown, base)

    def apply(self, setpoints: Mapping[str, float]) -> Mapping[str, float]:
        return {}

    def stop(self) -> None:
        """Halt the components. The agent ends the actions that move something."""
        for each in self._components:
            each.on_halt()

    def close(self) -> None:
        """Do nothing."""
