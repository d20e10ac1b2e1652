"""Hostile robots: whatever they serve, their pages keep working, the Stop button first."""

import hashlib
import json
import struct
from collections.abc import Iterator

import pytest
import zenoh
from playwright.sync_api import ConsoleMessage, Page, expect

from browser import Browser
from fake_robots import KEYS, FakeRobot, joint, link, open_session, robot
from linked_fleet_agent.wire.codec import encode, layout
from linked_fleet_agent.wire.messages import WIRE_VERSION, Description, Mesh
from small_fleet import Place, live

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
COLLADA = (
    '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset><unit meter="1"/></asset>'
    "<library_nodes>{nodes}</library_nodes><library_visual_scenes><visual_scene id='s'><node id='top'>"
    "<instance_node url='#n0'/></node></visual_scene></library_visual_scenes>"
    "<scene><instance_visual_scene url='#s'/></scene></COLLADA>"
)


def _doubling() -> bytes:
    """Return a tree of forty nodes, each of which contains the next one twice."""
    twice = [f"<node id='n{i}'>{f'''<instance_node url='#n{i + 1}'/>''' * 2}</node>" for i in range(40)]
    return COLLADA.format(nodes="".join(twice) + "<node id='n40'/>").encode()


def _glb(nodes: list[dict[str, object]]) -> bytes:
    """Return a binary glTF without a binary chunk; its mesh claims a million points."""
    document = {
        "asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": nodes,
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 10**6, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 12}], "buffers": [{"byteLength": 12}],
    }  # fmt: skip
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    return struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text), len(text), b"JSON") + text


# Each would block a script that reads it in the usual way for minutes or for ever.
FILES = {
    "nodes that repeat nodes": ("a.dae", "model/vnd.collada+xml", _doubling()),
    "facets that never end": ("a.stl", "model/stl", b"solid x " + b"facet " * 400_000 + b" endsolid x"),
    "more facets than there are": ("a.stl", "model/stl", bytes(80) + (10**8).to_bytes(4, "little") + bytes(500)),
    "a node that contains itself": ("a.glb", "model/gltf-binary", _glb(nodes=[{"children": [0]}])),
    "more numbers than there are": ("a.glb", "model/gltf-binary", _glb(nodes=[{"mesh": 0}])),
    "a million objects": ("a.obj", "model/obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n" + b"o a\nf 1 2 3\n" * 1_000_000),
}


@pytest.fixture(scope="module")
def gateway(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[zenoh.Session, Browser]]:
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (_, browser), open_session(place.zenoh) as session:
        yield session, browser


def _appear(session: zenoh.Session, name: str, file: str, media_type: str, content: bytes) -> None:
    """Add a robot whose base has this file as its mesh."""
    actor = FakeRobot(session, name)
    mesh = Mesh(uri=file, sha256=hashlib.sha256(content).hexdigest(), size=len(content), type=media_type)
    key = KEYS.robot(name, "mesh")
    actor.keep(session.declare_queryable(key, lambda query: query.reply(key, content), complete=True))
    base = f'<link name="base"><visual><geometry><mesh filename="{file}"/></geometry></visual></link>'
    said = Description(
        version=WIRE_VERSION,
        robot=name,
        incarnation=actor.incarnation,
        title=name,
        urdf=robot(base, link("tip"), joint("elbow", "revolute", "base", "tip")),
        joints=("elbow",),
        rate_hz=100,
        capabilities=("move", "stop"),
        meshes=(mesh,),
        layout=layout(1, False),
    )
    actor.appear(encode(said)).stand(0.1)


@pytest.mark.webgl
@pytest.mark.parametrize("kind", FILES)
def test_a_mesh_that_cannot_be_read_in_time_is_not_drawn(
    page: Page, gateway: tuple[zenoh.Session, Browser], kind: str
) -> None:
    """The rest of the robot is drawn, and the page continues."""
    session, browser = gateway
    _appear(session, kind, *FILES[kind])
    said: list[str] = []

    def note(message: ConsoleMessage) -> None:
        said.append(message.text)

    page.on("console", note)
    page.goto(live(browser, kind).url)
    page.locator("#scene").scroll_into_view_if_needed()
    expect(page.locator("#scene")).to_have_attribute("data-phase", "ready")
    if kind != "facets that never end":  # of which nothing is left
        assert any("is not drawn" in each for each in said), said
    page.locator("form.stop button").click()
    expect(page.locator("form.stop output")).not_to_be_empty()
