"""A robot whose components have values of every type, actions and events, for gateways of a test."""

import asyncio
from enum import StrEnum
from typing import Annotated, Literal

from msgspec import Meta, Struct

from linked_fleet_agent.components import Call, Component, action, event, unit, value
from linked_fleet_agent.robots.of_components import RobotOfComponents

URDF = """<robot name="cell"><link name="hand"/><link name="finger"/><joint name="slide" type="prismatic">
  <parent link="hand"/><child link="finger"/><limit lower="0" upper="0.08" velocity="0.1" effort="70"/></joint>
  </robot>"""
Width = Annotated[float, unit("M"), Meta(ge=0, le=0.08, title="Width")]


class Colour(StrEnum):
    RED = "red"
    GREEN = "green"


class Piece(Struct):
    label: Annotated[str, Meta(max_length=20)]
    size: Annotated[float, unit("M")] = 0.0


class Grasped(Struct):
    width: Width
    holding: bool


class Gripper(Component, blocking=False, rate_hz=100, stale_s=3):
    """Two fingers."""

    lost = event(Grasped)
    opened = event()

    def __init__(self) -> None:
        self.gap, self.thing, self.broken, self.gate = 0.08, 0.03, "", asyncio.Event()
        self.link = "hand"

    @value
    def width(self) -> Width:
        if self.broken:
            raise OSError(self.broken)
        return self.gap

    @action(moves=["slide"], duration_s=10, stop_s=0.2)
    async def grasp(
        self, call: Call[Width], width: Width = 0.0, force: Annotated[float, unit("N"), Meta(gt=0, le=70)] = 20.0
    ) -> Grasped:
        """Close the fingers until something is held."""
        while self.gap > max(width, self.thing):
            await asyncio.sleep(0.02)
            self.gap = max(width, self.thing, self.gap - 0.005)
            call.feedback(self.gap)
        return Grasped(self.gap, self.gap > width)

    @action(moves=["slide"], stop_s=0.2)
    async def wait(self) -> None:
        """Wait until the test lets it end."""
        await self.gate.wait()


class Lamp(Component, blocking=False, rate_hz=100):
    """A lamp."""

    def __init__(self) -> None:
        self.lit, self.hue, self.shelf, self.turns = False, Colour.RED, [Piece("nut", 0.5)], 3

    @value
    def on(self) -> bool:
        return self.lit

    @on.setter
    def set_on(self, on: bool) -> None:
        self.lit = on

    @value
    def colour(self) -> Colour:
        return self.hue

    @value
    def pieces(self) -> Annotated[list[Piece], Meta(max_length=4)]:
        return self.shelf

    @value
    def count(self) -> int:
        return self.turns

    @action()
    async def paint(self, colour: Literal["red", "green"]) -> None:
        """Paint it."""
        self.hue = Colour(colour)


class Cell(RobotOfComponents):
    """A robot of one joint that only its gripper moves."""

    def __init__(self) -> None:
        self.gripper, self.lamp = Gripper(), Lamp()
        super().__init__("Cell", self.gripper, self.lamp, urdf=URDF, measure=lambda: [self.gripper.gap])
