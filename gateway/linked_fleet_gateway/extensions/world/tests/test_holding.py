"""What a gripper says and does, and whether the object that a grasp has named is held after that."""

import asyncio
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import msgspec
import pytest
from msgspec.structs import replace

from linked_fleet_agent.wire.codec import encode_state, layout
from linked_fleet_agent.wire.messages import Description, State
from linked_fleet_base.errors import RedisUnavailable
from linked_fleet_gateway.app.application import create_live
from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_gateway.extensions.world import holding
from linked_fleet_gateway.extensions.world.collisions import Unchecked
from linked_fleet_gateway.extensions.world.held import pose_of
from linked_fleet_gateway.extensions.world.holding import Holding
from linked_fleet_gateway.extensions.world.placement import PLACEMENT
from linked_fleet_gateway.extensions.world.scene import Held, SceneObject, Sphere
from linked_fleet_state.events import Appeared, Described, Framed
from linked_fleet_state.gripper import Gripper
from linked_fleet_state.invocation import Invocation, InvocationState
from linked_fleet_state.model import Pose
from virtual.zenoh_network import ZenohNetwork

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
URDF = """<robot name="r"><link name="base"/><link name="palm"/><link name="finger"/>
  <joint name="turn" type="continuous"><parent link="base"/><child link="palm"/><axis xyz="0 0 1"/></joint>
  <joint name="slide" type="prismatic"><parent link="palm"/><child link="finger"/>
    <limit lower="0" upper="0.08" velocity="0.1" effort="70"/></joint></robot>"""
CUP = SceneObject(title="cup", kind="obstacle", pose=Pose((0.2, 0.0, 0.0), UPRIGHT), geometry=Sphere(0.05))
NAMES_CUP = "_:input <https://w3id.org/linked-fleet#object> <http://h/world/objects/cup> ."
CUP_IRI = '<http://h/world/objects/cup>" .'


@dataclass
class Part:
    gripper: Gripper


class Records:
    """The objects of the world, as a table keeps them: in memory, with outages and other gateways."""

    def __init__(self) -> None:
        self.known: dict[str, SceneObject] = {
            "cup": CUP,
            "box": CUP,
            "far": replace(CUP, pose=Pose((2.0, 0.0, 0.0), UPRIGHT)),
        }
        self.away = False
        self.meanwhile: SceneObject | None = None

    async def change(self, id: str, record: SceneObject) -> bool:
        await asyncio.sleep(0)
        if self.away:
            raise RedisUnavailable("it is away")
        if self.meanwhile is not None:
            self.known[id], self.meanwhile = self.meanwhile, None
            return False
        self.known[id] = record
        return True


class Cell:
    """A robot whose palm turns, with a gripper, and what its gateway keeps of it."""

    def __init__(self) -> None:
        self.live = create_live(GatewaySettings(), ZenohNetwork().gateway("g"))
        self.records, self.part = Records(), Part(Gripper(("slide",), "", False, 1))
        self.holding = Holding(self.live, self.records)  # type: ignore[arg-type]  # it uses these two members
        self.sequence = 0
        description = Description(
            version=1, robot="r", incarnation=1, title="r", urdf=URDF, joints=("turn", "slide"), rate_hz=100,
            capabilities=("move",), layout=layout(2, False),
        )  # fmt: skip
        for event in (Appeared("r", 1), Described(description)):
            self.live.fleet.apply(event, 1)
        self.robot = self.live.fleet.robots["r"]
        self.robot.parts = {"gripper": self.part}
        pose = {"position_m": (0.0, 0.0, 0.0), "orientation_xyzw": UPRIGHT}
        self.robot.settings = {PLACEMENT: msgspec.json.encode(pose).decode()}
        self.turn(0.0)

    def turn(self, angle: float) -> None:
        self.sequence += 1
        state = State(
            incarnation=1, sequence=self.sequence, monotonic_ns=self.sequence, wall_ns=self.sequence,
            positions=(angle, 0.0), velocities=(0.0, 0.0), efforts=(0.0, 0.0),
        )  # fmt: skip
        self.live.fleet.apply(Framed("r", encode_state(state)), self.sequence)
        self.robot.adopt_latest_frame()

    def act(self, action: str, at_ns: int, state: InvocationState = InvocationState.SUCCEEDED, **more: object) -> None:
        said: dict[str, object] = {"duration_s": 1.0, "ended_ns": at_ns + 1, "incarnation": 1} | more
        path = f"/r/gripper/actions/{action}"
        self.holding.hear_invocation(Invocation(str(at_ns), "r", path, {}, at_ns, 0, state=state, **said))  # type: ignore[arg-type]

    def grasp(self, at_ns: int, holds: bool = True, body: str = NAMES_CUP, **more: object) -> None:
        self.act("grasp", at_ns, body=body, outcome=f'{{"width": 0.1, "holding": {str(holds).lower()}}}', **more)

    def say(self, holds: bool | None, at_ns: int, lost_ns: int = 0) -> None:
        self.part.gripper = replace(self.part.gripper, holding=holds, holding_ns=at_ns, lost_ns=lost_ns)
        self.holding.hear_robot("r")

    @property
    def held(self) -> Held | None:
        return self.records.known["cup"].held

    def place(self) -> tuple[float, ...]:
        pose = pose_of(self.records.known["cup"], self.live.fleet.robots)
        return () if pose is None else tuple(round(each, 3) for each in pose.position_m)


Step = Callable[[Cell], None]


def steps(*each: Step) -> tuple[Step, ...]:
    return each


CASES: Mapping[str, tuple[tuple[Step, ...], bool]] = {
    "a grasp that holds something": (steps(lambda c: c.grasp(10)), True),
    "a grasp that holds nothing": (steps(lambda c: c.grasp(10, holds=False)), False),
    "a grasp with a text that looks as if it named something": (
        steps(
            lambda c: c.grasp(10, body='_:input <http://h/label> "<https://w3id.org/linked-fleet#object> ' + CUP_IRI)
        ),
        False,
    ),
    "a grasp of what is far away": (steps(lambda c: c.grasp(10, body=NAMES_CUP.replace("cup", "far"))), False),
    "a grasp that has failed": (steps(lambda c: c.grasp(10, state=InvocationState.FAILED)), False),
    "a grasp that names nothing": (steps(lambda c: c.grasp(10, body="")), False),
    "a grasp of what is gone": (steps(lambda c: c.grasp(10, body=NAMES_CUP.replace("cup", "pot"))), False),
    "a grasp in an earlier run of the agent": (steps(lambda c: c.grasp(10, incarnation=7)), False),
    "a grasp without a result": (steps(lambda c: c.act("grasp", 10, body=NAMES_CUP)), False),
    "another action": (steps(lambda c: c.act("wave", 10, body=NAMES_CUP, outcome='{"holding": true}')), False),
    "opened": (steps(lambda c: c.grasp(10), lambda c: c.act("open", 20)), False),
    "opening": (steps(lambda c: c.grasp(10), lambda c: c.act("open", 20, InvocationState.RUNNING)), False),
    "an opening that was refused": (
        steps(lambda c: c.grasp(10), lambda c: c.act("open", 20, InvocationState.FAILED, duration_s=None)),
        True,
    ),
    "an opening before": (steps(lambda c: c.grasp(10), lambda c: c.act("open", 5)), True),
    "an old grasp is heard of again": (
        steps(lambda c: c.grasp(10), lambda c: c.act("open", 20), lambda c: c.grasp(10)),
        False,
    ),
    "lost": (steps(lambda c: c.grasp(10), lambda c: c.say(True, 5, lost_ns=30)), False),
    "lost before": (steps(lambda c: c.grasp(10), lambda c: c.say(True, 5, lost_ns=3)), True),
    "says that it holds nothing": (steps(lambda c: c.grasp(10), lambda c: c.say(False, 30)), False),
    "has said so before": (steps(lambda c: c.grasp(10), lambda c: c.say(False, 5)), True),
    "does not know": (steps(lambda c: c.grasp(10), lambda c: c.say(None, 30)), True),
    "grasps something else": (
        steps(lambda c: c.grasp(10), lambda c: c.grasp(20, body=NAMES_CUP.replace("cup", "box"))),
        False,
    ),
    "grasps it again": (steps(lambda c: c.grasp(10), lambda c: c.grasp(20)), True),
}


@pytest.mark.parametrize("name", CASES)
async def test_the_object_is_held(name: str) -> None:
    case, expected = CASES[name]
    cell = Cell()
    for step in case:
        step(cell)
        await cell.holding.wait_until_settled()
    assert (cell.held is not None) is expected
    assert cell.records.known["far"].held is None
    assert cell.held is None or (cell.held.robot, cell.held.link, cell.held.gripper) == ("r", "palm", "gripper")


async def test_it_follows_the_palm_and_stays_where_it_is_let_go() -> None:
    cell = Cell()
    cell.grasp(10)
    await cell.holding.wait_until_settled()
    cell.turn(math.pi / 2)
    assert cell.place() == (0.0, 0.2, 0.0)
    cell.act("open", 20)
    cell.turn(math.pi)  # before it is written
    await cell.holding.wait_until_settled()
    assert cell.place() == (0.0, 0.2, 0.0)


async def test_what_is_let_go_at_an_unknown_place_is_held_until_somebody_says_where_it_is() -> None:
    cell = Cell()
    cell.grasp(10)
    await cell.holding.wait_until_settled()
    cell.robot.settings = {}
    cell.act("open", 20)
    await cell.holding.wait_until_settled()
    assert cell.held is not None and cell.held.gripper == "" and cell.place() == ()


@pytest.mark.virtual
async def test_motions_wait_until_what_a_gripper_did_is_written(monkeypatch: pytest.MonkeyPatch) -> None:
    cell = Cell()
    cell.records.away = True
    cell.grasp(10)
    with pytest.raises(Unchecked):
        await cell.holding.wait_until_settled()
    cell.records.away = False
    monkeypatch.setattr(holding, "_WAIT_S", 30.0)
    await cell.holding.wait_until_settled()
    assert cell.held is not None


async def test_a_change_by_another_gateway_meanwhile_is_kept() -> None:
    cell = Cell()
    cell.records.meanwhile = replace(CUP, title="mug")
    cell.grasp(10)
    await cell.holding.wait_until_settled()
    assert cell.records.known["cup"].title == "mug" and cell.held is not None
    there = cell.records.known["cup"]
    cell.records.meanwhile = replace(there, held=None, decided_ns=20)
    cell.act("open", 20)
    await cell.holding.wait_until_settled()
    assert cell.records.known["cup"] == replace(there, held=None, decided_ns=20), "the other gateway was first"


async def test_what_a_client_has_mounted_is_not_let_go_by_a_gripper() -> None:
    cell = Cell()
    cell.records.known["cup"] = replace(CUP, held=Held("r", "palm", CUP.pose), decided_ns=5)
    cell.act("open", 20)
    cell.say(False, 30, lost_ns=30)
    await cell.holding.wait_until_settled()
    assert cell.held is not None
