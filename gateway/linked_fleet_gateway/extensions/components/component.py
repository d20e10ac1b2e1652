"""A component of a robot: what it declares, and its present state."""

from functools import lru_cache

from pyoxigraph import Literal, NamedNode

from linked_fleet_agent.wire.components import BASE, Component
from linked_fleet_gateway.extensions.components.declarations import CompiledComponent, compile_declarations
from linked_fleet_gateway.extensions.components.state import ComponentState, RobotState
from linked_fleet_gateway.faces import joint_path, part_path, robot_path
from linked_fleet_state.model import RobotModel
from linked_fleet_state.robot import Robot

BASES = 16
"""Base URLs for which descriptions are kept."""


class DeclaredComponent:
    """A component of a robot."""

    def __init__(self, robot: Robot, model: RobotModel, state: RobotState, name: str) -> None:
        self.robot, self.name = robot, name
        self._model, self.whole = model, state
        self.path = part_path(robot.name, model, name)
        self.compiled = lru_cache(BASES)(self._compile)

    @property
    def state(self) -> ComponentState:
        return self.whole.components[self.name]

    @property
    def declared(self) -> Component:
        return self.state.declared

    @property
    def title(self) -> str:
        return self.declared.title or self.name

    @property
    def is_current(self) -> bool:
        """True if the values are those of the present run of the agent."""
        return self.whole.incarnation == self.robot.incarnation

    def moved(self, name: str, base: str) -> list[NamedNode | Literal]:
        """Return what an action moves: joints, or the word for the base."""
        moves, robot = self.declared.actions[name].moves, self.robot.name
        return [Literal(BASE) if each == BASE else NamedNode(base + joint_path(robot, each)) for each in moves]

    def _compile(self, base: str) -> CompiledComponent:
        return compile_declarations([self.declared], base + robot_path(self.robot.name)).components[self.name]
