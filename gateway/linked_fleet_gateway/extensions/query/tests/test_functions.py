"""The cost of ``lf:canReach`` in operations, since a query may ask about hundreds of links."""

import site
from pathlib import Path
from typing import Any

import pytest
from pyoxigraph import Literal, NamedNode

from linked_fleet_agent.wire.codec import encode_state, layout
from linked_fleet_agent.wire.messages import Description, State
from linked_fleet_gateway.extensions.reach import inverse_kinematics as reach
from linked_fleet_gateway.extensions.reach.can_reach import LF, CanReach
from linked_fleet_state import joint_chain
from linked_fleet_state.events import Appeared, Described, Framed
from linked_fleet_state.fleet import Fleet
from linked_fleet_state.model import RobotModel

BASE = "http://fleet.example"
BAXTER = Path(site.getsitepackages()[0]) / "cmeel.prefix/share/example-robot-data/robots/baxter_description/urdf"


@pytest.fixture
def baxter() -> Fleet:
    urdf = (BAXTER / "baxter.urdf").read_text()
    joints = tuple(joint.name for joint in RobotModel.parse(urdf).joints.values() if joint.movable)
    zeros = (0.0,) * len(joints)
    fleet = Fleet()
    fleet.apply(Appeared("baxter", 1), 1)
    said = Description(
        version=1, robot="baxter", incarnation=1, title="Baxter", urdf=urdf, joints=joints, rate_hz=100, base="fixed",
        capabilities=("move", "stop"), annotations="", layout=layout(len(joints), False),
    )  # fmt: skip
    fleet.apply(Described(said), 1)
    state = State(
        incarnation=1, sequence=1, monotonic_ns=1, wall_ns=1, positions=zeros, velocities=zeros, efforts=zeros
    )  # fmt: skip
    fleet.apply(Framed("baxter", encode_state(state)), 1)
    return fleet


def test_few_searches_are_made_in_vain_and_the_urdf_is_read_once(
    baxter: Fleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A search without a result takes 0.1 s; reading the URDF takes as long as several successful ones."""
    vain: list[str] = []
    reads: list[str] = []
    search, read = reach.reach, joint_chain.build_model

    def counted(*arguments: Any) -> reach.Solution:
        try:
            return search(*arguments)
        except reach.Unreachable:
            vain.append(arguments[2])
            raise

    monkeypatch.setattr(reach, "reach", counted)
    monkeypatch.setattr(joint_chain, "build_model", lambda *said: reads.append("") or read(*said))
    joint_chain.chain_to.cache_clear()
    model = baxter.robots["baxter"].model
    assert model is not None
    can_reach = CanReach().bind(BASE, baxter.robots)[LF.canReach]
    place = [Literal(each) for each in (0.5, 0.2, 0.4)]
    answers = {link: can_reach(NamedNode(f"{BASE}/baxter/{link}"), *place) for link in model.links}
    assert answers["left_gripper"] == Literal(True) and answers["head"] == Literal(False)
    assert len(vain) <= 4, vain
    assert len(reads) <= 1
