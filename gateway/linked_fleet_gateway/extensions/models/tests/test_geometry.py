"""The served URDF: meshes at their addresses, and nothing that a browser would load or run."""

from operator import mul
from xml.etree import ElementTree

import pytest

from linked_fleet_agent.robots.catalogue import MODELS, data_folder, urdf_of
from linked_fleet_gateway.extensions.models.geometry import urdf_with_mesh_addresses
from linked_fleet_state.model import ModelError, RobotModel

ADDRESSES = {"package://p/a.stl": "/r/meshes/aa.stl", "b.dae": "/r/meshes/bb.dae"}


def _shown(*inner: str) -> ElementTree.Element:
    return ElementTree.fromstring(
        urdf_with_mesh_addresses(f'<robot name="r"><link name="l">{"".join(inner)}</link></robot>', ADDRESSES)
    )


def _visual(uri: str, more: str = "") -> str:
    return f'<visual name="{uri}"><geometry><mesh filename="{uri}" scale="1 1 1"/></geometry>{more}</visual>'


def test_meshes_stand_at_their_addresses_and_the_rest_stays() -> None:
    colour = '<material name="m"><color rgba="1 0 0 1"/></material>'
    robot = _shown(_visual("package://p/a.stl", colour), _visual("b.dae"), "<inertial><mass value='2'/></inertial>")
    assert [mesh.attrib for mesh in robot.iter("mesh")] == [
        {"filename": "/r/meshes/aa.stl", "scale": "1 1 1"},
        {"filename": "/r/meshes/bb.dae", "scale": "1 1 1"},
    ]
    assert robot.find("link/visual/material/color").attrib == {"rgba": "1 0 0 1"}
    assert robot.find("link/inertial/mass").get("value") == "2"


def test_geometry_whose_mesh_is_missing_is_left_out() -> None:
    collision = _visual("http://elsewhere.example/x.stl").replace("visual", "collision")
    box = '<visual><geometry><box size="1 1 1"/></geometry></visual>'
    robot = _shown(_visual("missing.stl"), collision, box, '<mesh filename="/etc/passwd"/>', "<mesh/>")
    assert [each.tag for each in robot.iter()] == ["robot", "link", "visual", "geometry", "box"]


@pytest.mark.parametrize(
    "hostile",
    [
        '<h:script xmlns:h="http://www.w3.org/1999/xhtml">alert(1)</h:script>',
        '<svg xmlns="http://www.w3.org/2000/svg" onload="alert(1)"/>',
        '<visual xmlns:xlink="http://www.w3.org/1999/xlink" xlink:href="javascript:alert(1)"/>',
        '<visual><material name="m"><texture filename="http://elsewhere.example/t.png"/></material></visual>',
        '<?xml-stylesheet href="http://elsewhere.example/t.xsl"?><!-- comment -->',
    ],
)
def test_nothing_of_other_vocabularies_is_passed_on(hostile: str) -> None:
    text = urdf_with_mesh_addresses(f'<robot name="r"><link name="l">{hostile}</link></robot>', ADDRESSES).decode()
    for part in ("script", "svg", "xmlns", "href", "texture", "elsewhere", "comment", "<?xml-"):
        assert part not in text


def test_text_stays_text() -> None:
    evil = "&lt;/robot&gt;&quot;&apos;&lt;script&gt;"
    robot = f'<robot name="{evil}"><link name="{evil}">{evil}</link></robot>'
    shown = ElementTree.fromstring(urdf_with_mesh_addresses(robot, ADDRESSES))
    assert shown.get("name") == shown.find("link").get("name") == "</robot>\"'<script>"


def test_deeply_nested_xml_is_refused() -> None:
    depth = 50_000
    with pytest.raises(ModelError, match="nested deeper"):
        urdf_with_mesh_addresses(f'<robot name="r">{"<a>" * depth}{"</a>" * depth}</robot>', {})


@pytest.mark.parametrize("urdf", ["", "<robot>", '<!DOCTYPE r [<!ENTITY x "y">]><robot name="r">&x;</robot>'])
def test_xml_with_a_doctype_is_refused(urdf: str) -> None:
    with pytest.raises(ModelError):
        urdf_with_mesh_addresses(urdf, {})


@pytest.mark.parametrize("name", sorted(MODELS))
def test_real_robots_keep_their_kinematics(name: str) -> None:
    urdf = urdf_of(MODELS[name], (data_folder() / MODELS[name].file).read_text(), name)
    before, after = RobotModel.parse(urdf), RobotModel.parse(urdf_with_mesh_addresses(urdf, {}).decode())
    assert list(before.joints) == list(after.joints)
    for old, new in zip(before.joints.values(), after.joints.values(), strict=True):
        assert (old.kind, old.parent, old.child, old.mimic) == (new.kind, new.parent, new.child, new.mimic)
        assert new.stops == (old.stops if old.movable else (None, None))
        assert new.axis == pytest.approx(old.axis, abs=1e-15)
        assert new.origin.position_m == old.origin.position_m
        assert abs(sum(map(mul, new.origin.orientation_xyzw, old.origin.orientation_xyzw))) == pytest.approx(
            1, abs=1e-15
        )
