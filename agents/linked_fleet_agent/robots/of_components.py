"""A driver for robots that only their components move: a gripper, a switch box, a cell with a program of its own."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from xml.sax.saxutils import quoteattr

from linked_fleet_agent.components.component import Component
from linked_fleet_agent.robot import Facts, Reading
from linked_fleet_agent.urdf import joints_of


class RobotOfComponents:
    """A robot whose joints, if it has any, take no commands but the actions of its ``components``.

    ``urdf`` is a single link by default. ``measure`` returns the positions of its joints in their order (rad or m).
    """

    def __init__(
        self,
        title: str,
        *components: Component,
        urdf: str = "",
        measure: Callable[[], Sequence[float]] = tuple,
    ) -> None:
        urdf = urdf or f'<robot name={quoteattr(title)}><link name="base"/></robot>'
        joints = tuple(replace(joint, passive=True) for joint in joints_of(urdf))
        self._facts, self._components, self._measure = Facts(title, urdf, joints), components, measure
        self._unknown = (math.nan,) * len(joints)

    def describe(self) -> Facts:
        return self._facts

    def components(self) -> Sequence[Component]:
        return self._components

    def read(self, now_s: float) -> Reading:
        return Reading(tuple(self._measure()), self._unknown, self._unknown)

    def apply(self, setpoints: Mapping[str, float]) -> Mapping[str, float]:
        return {}

    def stop(self) -> None:
        """Do nothing: the agent ends the actions that move something."""

    def close(self) -> None:
        """Do nothing."""
