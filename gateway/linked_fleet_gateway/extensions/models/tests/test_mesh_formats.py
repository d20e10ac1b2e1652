"""Mesh files of one bar in several formats and units: the same surface, or a reason."""

import json
import struct

import numpy as np
import pytest

from linked_fleet_gateway.extensions.world.surfaces import read_mesh
from linked_fleet_state.xml import ModelError
from mesh_package import BAR, collada, glb
from meshes import stl

LOW, HIGH = (-0.03, -0.03, 0.0), (0.03, 0.03, 0.3)


def with_json(**changes: object) -> bytes:
    """Return the bar as binary glTF with other members of its document."""
    content = glb(BAR)
    (size,) = struct.unpack_from("<I", content, 12)
    text = json.dumps(json.loads(content[20 : 20 + size]) | changes).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + content[20 + size :]
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


@pytest.mark.parametrize(
    ("suffix", "content"),
    [
        ("stl", stl(BAR)),
        ("dae", collada(BAR, 0.01).encode()),
        ("dae", collada(BAR, 0.001).encode()),
        ("dae", collada(BAR, 0.0254).encode()),
        ("dae", collada(BAR, 1.0).encode()),
        ("dae", collada(BAR, None).encode()),
        ("dae", collada(BAR, 0.01, "Y_UP").encode()),
        ("dae", collada(BAR, 0.01, "X_UP").encode()),
        ("dae", collada(BAR, 0.01, head='<!-- <unit meter="7"/> -->').encode()),
        ("dae", collada(BAR, None).replace("</scene>", '</scene><extra><unit meter="7"/></extra>').encode()),
        ("glb", glb(BAR)),
        ("glb", with_json(nodes=[{"children": [1], "scale": [0.5, 0.5, 0.5]}, {"mesh": 0, "scale": [2, 2, 2]}])),
        ("glb", with_json(images=[{"uri": "data:image/png;base64,AA=="}])),
    ],
)
def test_a_mesh_is_read_in_metre_and_in_its_own_axes(suffix: str, content: bytes) -> None:
    """As RViz and the scene of the pages do; nothing turns it upright."""
    surface = read_mesh(suffix, content)
    assert surface.vertices.min(axis=0) == pytest.approx(np.array(LOW), abs=1e-6)
    assert surface.vertices.max(axis=0) == pytest.approx(np.array(HIGH), abs=1e-6)
    assert surface.fills_hull and len(surface.triangles) == len(BAR)


@pytest.mark.parametrize(
    ("suffix", "content", "reason"),
    [
        ("dae", b"<COLLADA>", "no well-formed XML"),
        ("dae", collada(BAR, 0.01).replace('meter="0.01"', 'meter="a"').encode(), "'a' metre is no number"),
        ("dae", collada(BAR, 0.01).replace('meter="0.01"', 'meter="0"').encode(), "0 m, which is out of all bounds"),
        ("dae", collada(BAR, 0.01).replace('meter="0.01"', 'meter="-1"').encode(), "-1 m, which is out of all bounds"),
        ("dae", collada(BAR, 0.01).replace('meter="0.01"', 'meter="nan"').encode(), "out of all bounds"),
        ("dae", collada(BAR, 0.01).replace('meter="0.01"', 'meter="1e9"').encode(), "vertices out of all bounds"),
        ("glb", b"", "no binary glTF 2.0"),
        ("glb", stl(BAR), "no binary glTF 2.0"),
        ("glb", glb(BAR)[:40], "no binary glTF 2.0"),
        ("glb", struct.pack("<4sIII4s", b"glTF", 2, 24, 4, b"JSON") + b"[[[[", "no binary glTF 2.0"),
        ("glb", glb(BAR)[:-400], "cannot be read as glb"),
        ("glb", with_json(extensionsRequired=["KHR_draco_mesh_compression"]), "needs the glTF extensions"),
        ("glb", with_json(buffers=[{"byteLength": 864, "uri": "../secret.bin"}]), "its buffers are in other files"),
        ("glb", with_json(images=[{"uri": "/etc/hostname"}]), "its images are in other files"),
        ("glb", with_json(nodes=[{}]), "cannot be read as glb"),
        ("glb", with_json(nodes={}), "it has no scene"),
        ("glb", with_json(scenes=[]), "it has no scene"),
        ("glb", with_json(buffers=[1]), "it has no scene"),
        ("glb", with_json(nodes=[{"children": [0]}]), "cannot be read as glb"),
    ],
)
def test_a_mesh_that_cannot_be_read_says_why(suffix: str, content: bytes, reason: str) -> None:
    with pytest.raises(ModelError, match=reason):
        read_mesh(suffix, content)
