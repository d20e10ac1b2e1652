"""A cell with a task of its own, which somebody else has programmed: ``pick``, with feedback, result and cancellation.

Usage: python picker.py [--connect tcp/127.0.0.1:7447] and further flags of linked-fleet-agent

The cell is simulated. Replace the lines that end with "cell" by those that speak to yours.
"""

from typing import Annotated, Literal

from msgspec import Meta, Struct

from linked_fleet_agent.components import BASE, Call, Component, action, event, unit, value
from linked_fleet_agent.robots.of_components import RobotOfComponents
from linked_fleet_agent.serving import run

Count = Annotated[int, Meta(ge=1, le=20, title="Number of parts")]
PICK_S = 0.5


class Step(Struct):
    part: Annotated[int, Meta(title="Number of the part")]
    doing: Literal["approach", "take", "place"]


class Picked(Struct):
    parts: Annotated[int, Meta(title="Parts that were placed")]
    mass: Annotated[float, unit("KiloGM"), Meta(ge=0, title="Mass of all")]


class Cell(Component):
    """A cell that puts parts from a bin into a tray."""

    empty = event(title="Bin is empty")
    left = 100  # cell

    @value
    def parts(self) -> Annotated[int, Meta(ge=0, title="Parts in the bin")]:
        return self.left  # cell

    @action(moves=[BASE], duration_s=60, stop_s=1, rehearse=lambda self, count: 3 * PICK_S * count)
    def pick(self, call: Call[Step], count: Count = 1) -> Picked:
        """Put parts into the tray. When it is cancelled, the part in the hand is still placed."""
        done = 0
        while done < count and self.left and not call.cancelled:
            call.progress(done / count)
            for doing in ("approach", "take", "place"):
                call.feedback(Step(done + 1, doing))
                call.sleep(PICK_S) if doing == "approach" else None  # cell
            self.left, done = self.left - 1, done + 1  # cell
        if not self.left:
            self.empty()
        call.check()
        return Picked(done, 0.2 * done)


if __name__ == "__main__":
    run("cell", RobotOfComponents("Picking cell", Cell()))
