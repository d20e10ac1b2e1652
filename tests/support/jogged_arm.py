"""An arm whose joints reach every setpoint at once, unless something holds them, jogged under its agent."""

import itertools
import math
from collections.abc import Mapping
from typing import Any

from msgspec import Raw, json

from component_agent import Bench
from linked_fleet_agent.components import Component
from linked_fleet_agent.robot import Facts, Reading
from linked_fleet_agent.urdf import joints_of
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.components import Sample
from linked_fleet_agent.wire.messages import Accepted

TICK_S = 0.01
LIMITS = {"turn": (-2.0, 2.0), "elbow": (-0.5, 1.0), "lift": (0.0, 0.3), "wrist 1": (-math.inf, math.inf)}


def _joint(name: str, kind: str, parent: str, child: str, velocity: float) -> str:
    lower, upper = LIMITS[name]
    limit = "" if kind == "continuous" else f'lower="{lower}" upper="{upper}"'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><axis xyz="0 0 1"/>'
        f'<limit {limit} velocity="{velocity}" effort="10"/></joint>'
    )


ARM = (
    '<robot name="arm"><link name="a"/><link name="b"/><link name="c"/><link name="d"/><link name="e"/>'
    + _joint("turn", "revolute", "a", "b", 2.0)
    + _joint("elbow", "revolute", "b", "c", 1.0)
    + _joint("lift", "prismatic", "c", "d", 0.2)
    + _joint("wrist 1", "continuous", "d", "e", 3.0)
    + "</robot>"
)


class Arm:
    """Four joints, with the components that a test gives it."""

    def __init__(self, *components: Component, **positions: float) -> None:
        self.positions = {"turn": 0.0, "elbow": 0.0, "lift": 0.1, "wrist 1": 0.0} | positions
        self.held: set[str] = set()
        """Joints that something holds where they are."""
        self.unknown: set[str] = set()
        self.path = [dict(self.positions)]
        self._components = components

    def describe(self) -> Facts:
        return Facts("Arm", ARM, joints_of(ARM))

    def components(self) -> tuple[Component, ...]:
        return self._components

    def read(self, now_s: float) -> Reading:
        self.path.append(dict(self.positions))
        shown = (math.nan if name in self.unknown else each for name, each in self.positions.items())
        return Reading(tuple(shown), (math.nan,) * 4, (math.nan,) * 4)

    def apply(self, setpoints: Mapping[str, float]) -> Mapping[str, float]:
        self.positions |= {name: each for name, each in setpoints.items() if name not in self.held}
        return setpoints

    def stop(self) -> None: ...

    close = stop


class Jogged(Bench):
    """The arm and its agent."""

    def __init__(self, *components: Component, **positions: float) -> None:
        self.arm = Arm(*components, **positions)
        super().__init__(other=self.arm)

    def request(self, id: str, duration: float = 0.5, **velocities: float) -> None:
        given = {"velocities": velocities, "duration": duration}
        reply = self.operate(id, "jogJoints", given, component="jogging")
        assert isinstance(reply, Accepted), reply

    def open(self, id: str = "s") -> None:
        reply = self.operate(id, "jogJoints", {}, component="jogging", stream=True)
        assert isinstance(reply, Accepted), reply

    def sample(self, number: int, velocities: Mapping[str, Any], *, id: str = "s", age_ms: float = 0) -> None:
        said = Sample(
            version=2, id=id, incarnation=self.agent.incarnation, number=number,
            seen_ns=round(self.now_ns - age_ms * 1e6), input=Raw(json.encode({"velocities": velocities})),
        )  # fmt: skip
        self.agent.handle_sample(codec.encode(said))

    async def jog(self, seconds: float, *, id: str = "s", first: int = 0, **velocities: float) -> int:
        """Send samples thirty times a second. Return the number of the next one."""
        count = round(seconds * 100)
        for tick in range(count):
            if tick % 3 == 0:
                self.sample(first + tick, velocities, id=id)
            await self.tick()
        return first + count

    def velocities(self, joint: str, ticks: int = 1) -> list[float]:
        """Return the velocities of a joint in the last ticks."""
        path = [each[joint] for each in self.arm.path[-ticks - 1 :]]
        return [(after - before) / TICK_S for before, after in itertools.pairwise(path)]

    def speed(self, joint: str) -> float:
        return self.velocities(joint)[0]

    def shown(self, name: str) -> Any:
        """Return the value of the component that was published last."""
        told = [each.components["jogging"].values for each in self.link.values if "jogging" in each.components]
        return json.decode(next(each[name] for each in reversed(told) if name in each))
