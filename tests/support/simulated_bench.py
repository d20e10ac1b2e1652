"""An agent of a simulated robot of the catalogue, on the test's own clock, with a link that has no network."""

from typing import Any

import msgspec

from component_agent import Bench
from linked_fleet_agent.robots.catalogue import load
from linked_fleet_agent.robots.mujoco_robot import MujocoRobot
from linked_fleet_agent.robots.simulated_fingers import Fingers
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.components import Values
from linked_fleet_agent.wire.messages import Accepted


class Simulated(Bench):
    """A robot of the catalogue with its agent."""

    def __init__(self, source: str) -> None:
        robot = load(source, source)
        assert isinstance(robot, MujocoRobot)
        self.mujoco = robot
        super().__init__(other=robot)

    @property
    def fingers(self) -> Fingers:
        return next(iter(self.mujoco.fingers.values()))

    def shown(self, component: str) -> dict[str, Any]:
        """Return the values of a component as a gateway that has just come gets them."""
        said = codec.decode(self.agent.values(), Values).components[component]
        return {name: msgspec.json.decode(each) for name, each in said.values.items()}

    async def do(self, component: str, action: str, seconds: float = 3.0, /, **given: object) -> str:
        """Carry out an action and return its end."""
        id = f"{action}-{self.now_ns}"
        reply = self.operate(id, action, given or None, component=component)
        assert isinstance(reply, Accepted), reply
        await self.tick(seconds)
        return self.end(id).state

    async def set(self, component: str, name: str, to: object) -> None:
        id = f"{name}-{self.now_ns}"
        assert isinstance(self.operate(id, "", to, property=name, component=component), Accepted)
        await self.until(lambda: self.states(id)[-1:] == ["succeeded"])
