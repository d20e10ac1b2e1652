"""Tokens, descriptions and frames of several runs in any order, beside a simple model of what the fleet must show."""

import math
import random

import msgspec
import pytest

from linked_fleet_agent.wire.codec import encode_state, layout
from linked_fleet_agent.wire.messages import WIRE_VERSION, Description, State
from linked_fleet_state.fleet import Appeared, Described, Fleet, Framed, Vanished

_URDF = """<robot name='r'><link name='a'/><link name='b'/><link name='c'/>
<joint name='turn' type='continuous'><parent link='a'/><child link='b'/><axis xyz='0 0 1'/></joint>
<joint name='slide' type='continuous'><parent link='b'/><child link='c'/><axis xyz='0 0 1'/></joint></robot>"""
_WHOLE = Description(
    version=WIRE_VERSION, robot="r", incarnation=0, title="R", urdf=_URDF, joints=("turn", "slide"), rate_hz=50,
    layout=layout(2, False),
)  # fmt: skip
_PART = msgspec.structs.replace(_WHOLE, joints=("turn",), layout=layout(1, False))
_UNUSABLE = msgspec.structs.replace(_WHOLE, joints=("turn", "turn"))


def _frame(run: int, sequence: int, joints: int, turn: float) -> bytes:
    row = (turn,) * joints
    return encode_state(
        State(
            incarnation=run, sequence=sequence, monotonic_ns=sequence, wall_ns=sequence,
            positions=row, velocities=row, efforts=row,
        )
    )  # fmt: skip


class Model:
    """The highest run with a token is the present one; its frames count if they are newer and fit its description."""

    def __init__(self) -> None:
        self.said: dict[int, Description | None] = {}
        self.present: int | None = None
        self.shown: Description | None = None
        self.sequence, self.joints, self.turn = -1, 0, math.nan

    def elect(self) -> None:
        run = max(self.said, default=self.present)
        if run != self.present:
            self.present, self.sequence, self.joints, self.turn = run, -1, 0, math.nan
            self.show(self.said.get(run or 0))

    def show(self, said: Description | None) -> None:
        self.shown = said or self.shown
        if self.described and self.shown is not None and self.joints not in (0, len(self.shown.joints)):
            self.sequence, self.joints, self.turn = -1, 0, math.nan

    @property
    def described(self) -> bool:
        shown = self.shown
        return shown is not None and shown.incarnation == self.present and len(set(shown.joints)) == len(shown.joints)

    def frame(self, run: int, sequence: int, joints: int, turn: float) -> None:
        fits = not self.described or (self.shown is not None and joints == len(self.shown.joints))
        if run == self.present and sequence > self.sequence and fits:
            self.sequence, self.joints, self.turn = sequence, joints, turn


@pytest.mark.parametrize("seed", range(100))
def test_the_present_run_is_shown_by_its_description_and_its_latest_frame(seed: int) -> None:
    dice, fleet, model = random.Random(seed), Fleet(), Model()
    fleet.apply(Appeared("r", 1), 0)
    fleet.apply(Described(msgspec.structs.replace(_WHOLE, incarnation=1)), 0)
    model.said[1] = model.shown = msgspec.structs.replace(_WHOLE, incarnation=1)
    model.present = 1
    sequences = dict.fromkeys((1, 2, 3), 0)
    for now in range(200):
        run = dice.choice((1, 2, 3))
        match dice.randrange(8):
            case 0:
                fleet.apply(Appeared("r", run), now)
                model.said.setdefault(run, None)
            case 1:
                fleet.apply(Vanished("r", run), now)
                model.said.pop(run, None)
            case 2:
                said = msgspec.structs.replace(dice.choice((_WHOLE, _WHOLE, _PART, _UNUSABLE)), incarnation=run)
                fleet.apply(Described(said), now)
                if run in model.said:
                    model.said[run] = said
                    if run == model.present:
                        model.show(said)
            case _:
                sequences[run] = max(0, sequences[run] + dice.choice((1, 1, 1, 0, -1)))
                frame = (run, sequences[run], dice.choice((1, 2, 2)), dice.random())
                if not fleet.frames.put("r", payload := _frame(*frame), now):
                    fleet.apply(Framed("r", payload), now)
                model.frame(*frame)
        model.elect()
        robot = fleet.robots["r"]
        shown = (robot.online, robot.incarnation, robot.described)
        assert shown == (bool(model.said), model.present, model.described), now
        turn = robot.positions.get("turn", math.nan)
        expected = model.turn if model.described else math.nan
        assert turn == expected or (math.isnan(turn) and math.isnan(expected)), now
