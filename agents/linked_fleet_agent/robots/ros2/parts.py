"""The parts of a ROS robot beside its joints: controllers that follow trajectories, components, its whereabouts."""

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, field

from linked_fleet_agent.components.component import Component
from linked_fleet_agent.robots.ros2.base import RosBase, Whereabouts
from linked_fleet_agent.robots.ros2.following import Following
from linked_fleet_agent.wire.components import BASE


@dataclass
class Parts:
    """The parts of one robot, beside its joint states.

    ``held`` gives by joint why it takes no commands now, ``anew`` says why the robot should be loaded again; empty if
    it need not. ``stamps`` is a sentence about time stamps that are none. The robot sets ``position``, which returns
    the measured position of a joint, and ``bad_states``.
    """

    components: list[Component] = field(default_factory=list)
    following: Following = field(default_factory=Following)
    whereabouts: Whereabouts | None = None
    held: dict[str, str] = field(default_factory=dict)
    anew: str = ""
    stamps: str = ""
    position: Callable[[str], float] = field(default=lambda joint: math.nan)
    bad_states: Callable[[], int] = field(default=lambda: 0)

    @property
    def is_busy(self) -> bool:
        return self.following.is_busy

    def end_others(self, moved: Collection[str]) -> None:
        """Cancel what other clients move: goals of actions, and velocities of a base."""
        self.following.end_others(moved)
        for each in self.components:
            if isinstance(each, RosBase) and BASE in moved:
                each.stand()
