"""The named poses of the demonstration robots, as in their annotations."""

from pathlib import Path
from urllib.parse import unquote

import pytest
import rdflib
from rdflib import DCTERMS, Namespace, URIRef

from linked_fleet_agent.robot import JointFacts, Limits
from linked_fleet_agent.robots.catalogue import MODELS, Model, facts_of, load, poses_of, urdf_of
from linked_fleet_agent.urdf import RobotModel, UrdfError
from linked_fleet_agent.wire.keys import unescape

LF = Namespace("https://w3id.org/linked-fleet#")
VOM = Namespace("http://vocab.arvida.de/2015/06/vom/vocab#")
UNIT = Namespace("http://qudt.org/vocab/unit/")
ROBOT = URIRef("http://fleet.example/robot/")


def _said(annotations: str) -> dict[str, dict[str, tuple[float, URIRef]]]:
    graph = rdflib.Graph().parse(data=annotations, format="turtle", publicID=str(ROBOT))
    found: dict[str, dict[str, tuple[float, URIRef]]] = {}
    for pose in graph.objects(ROBOT, LF.namedPose):
        targets = found[str(graph.value(pose, DCTERMS.title))] = {}
        for target in graph.objects(pose, LF.target):
            joint = unescape(unquote(str(graph.value(target, LF.ofJoint)).removeprefix(str(ROBOT))))
            position, unit = graph.value(target, VOM.numericalValue), graph.value(target, VOM.unit)
            assert isinstance(unit, URIRef)
            targets[joint] = (float(str(position)), unit)
    return found


@pytest.mark.parametrize("source", sorted(name for name, model in MODELS.items() if model.home))
def test_the_annotations_name_the_poses_with_their_units_and_within_the_limits(source: str) -> None:
    facts = load(source, source).describe()
    joints = {joint.name: joint for joint in facts.joints}
    said = _said(facts.annotations)
    assert len(said) > 1
    assert "home" in said
    for pose in said.values():
        for name, (position, unit) in pose.items():
            assert joints[name].mimics is None
            assert joints[name].limits.clamp(position) == position
            assert unit == (UNIT.M if joints[name].linear else UNIT.RAD)
    poses = poses_of(MODELS[source], facts.joints)
    assert {title: {name: at for name, (at, _) in pose.items()} for title, pose in said.items()} == poses
    assert not {"wheel_left_joint", "wheel_right_joint"} & said["home"].keys()
    assert set(said["home"]) == {j.name for j in facts.joints if j.mimics is None and not j.continuous}


def test_a_name_that_is_no_plain_segment_is_escaped() -> None:
    """Characters with a meaning in Turtle are escaped, too."""
    urdf = (
        '<robot name="r"><link name="a"/><link name="b"/><joint name="arm 2/&gt;left" type="prismatic">'
        '<parent link="a"/><child link="b"/><limit lower="0.1" upper="1" velocity="1" effort="1"/></joint></robot>'
    )
    model = Model("r.urdf", 'The "r"', "one \\ joint", poses={'the "far" end': {"arm 2/>left": 2.0}})
    assert _said(facts_of(model, urdf).annotations) == {'the "far" end': {"arm 2/>left": (1.0, UNIT.M)}}


def test_home_has_what_is_commanded_and_does_not_turn_endlessly() -> None:
    joints = (
        JointFacts("arm", limits=Limits(0.1, 1.0)),
        JointFacts("wheel", continuous=True),
        JointFacts("finger", mimics="arm"),
    )
    assert poses_of(Model("f", "t", "c", home={"wheel": 1.0}), joints) == {"home": {"arm": 0.1}}


def test_a_file_of_somebody_s_own_has_no_named_pose(tmp_path: Path) -> None:
    file = tmp_path / "door.urdf"
    file.write_text('<robot name="door"><link name="frame"/></robot>')
    assert not _said(facts_of(Model(str(file), "door", "c"), file.read_text()).annotations)


def test_the_transport_base_is_cut_out_of_the_file_of_tiago() -> None:
    """Its description is small, and has all that hangs on the base without the torso and what is above."""
    facts, whole = load("cart", "pmb2").describe(), RobotModel.parse(load("t", "tiago").describe().urdf)
    cut = RobotModel.parse(facts.urdf)
    assert cut.name == "cart"
    assert len(facts.urdf) < 20_000
    assert {name for name in whole.links if "caster" in name or "wheel" in name or "base" in name} <= cut.links.keys()
    assert not [name for name in cut.links if "torso" in name or "arm" in name or "head" in name]
    assert [joint.name for joint in facts.joints if not joint.passive] == []
    assert facts.meshes, "its meshes are found"
    assert cut.joints["wheel_left_joint"].origin == whole.joints["wheel_left_joint"].origin


def test_a_file_that_has_not_the_joint_to_cut_at_is_refused() -> None:
    with pytest.raises(UrdfError, match="it has no joint 'neck', at which this robot is cut out of it"):
        urdf_of(Model("f", "t", "c", cut_at=("neck",)), '<robot name="r"><link name="a"/></robot>', "r")
