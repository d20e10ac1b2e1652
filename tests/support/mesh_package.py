"""A package with a robot whose tool is a bar of 6 × 6 × 30 cm, in meshes of several formats and units."""

import json
import struct
from pathlib import Path

from meshes import Triangle, box, stl

PACKAGE = "p-with-dashes"
BAR = box((0.0, 0.0, 0.15), (0.06, 0.06, 0.3))
_INERTIAL = '<inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'


def robot(mesh: str) -> str:
    """Return the URDF of the robot, whose tool turns by ``j`` 40 cm above the base."""
    shapes = "".join(f'<{kind}><geometry><mesh filename="{mesh}"/></geometry></{kind}>' for kind in _KINDS)
    return (
        f'<robot name="r"><link name="base">{_INERTIAL}</link><link name="tool">{_INERTIAL}{shapes}</link>'
        '<joint name="j" type="revolute"><origin xyz="0 0 0.4"/><parent link="base"/><child link="tool"/>'
        '<axis xyz="0 1 0"/><limit lower="-1.6" upper="1.6" velocity="1" effort="50"/></joint></robot>'
    )


_KINDS = ("visual", "collision")


def write(folder: Path, mesh: str) -> Path:
    """Write the package below ``folder``; return the path of the URDF, which names the mesh ``mesh``."""
    package = folder / PACKAGE
    (package / "meshes").mkdir(parents=True, exist_ok=True)
    (package / "urdf").mkdir(exist_ok=True)
    files = {"bar.stl": stl(BAR), "m x.stl": stl(BAR), "bar.glb": glb(BAR), "bar_cm.dae": collada(BAR, 0.01).encode()}
    for name, content in files.items():
        (package / "meshes" / name).write_bytes(content)
    file = package / "urdf" / "r.urdf"
    file.write_text(robot(mesh))
    return file


def glb(triangles: list[Triangle]) -> bytes:
    """Return a binary glTF 2.0 in metres (Khronos, "Binary glTF Layout")."""
    points = b"".join(struct.pack("<3f", *point) for each in triangles for point in each)
    count = 3 * len(triangles)
    position = {"bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3",
                "min": [-9, -9, -9], "max": [9, 9, 9]}  # fmt: skip
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [position],
        "bufferViews": [{"buffer": 0, "byteLength": len(points)}],
        "buffers": [{"byteLength": len(points)}],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(points), b"BIN\0") + points
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def collada(triangles: list[Triangle], metre: float | None, up: str = "Z_UP", head: str = "") -> str:
    """Return a COLLADA 1.4.1 document whose unit of length is ``metre``; None states no unit."""
    scale = 1.0 if metre is None else metre
    values = " ".join(f"{x / scale:.9g}" for each in triangles for point in each for x in point)
    count = 3 * len(triangles)
    unit = "" if metre is None else f'<unit name="u" meter="{metre}"/>'
    return (
        f'<?xml version="1.0"?>{head}<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
        f"<asset>{unit}<up_axis>{up}</up_axis></asset>"
        f'<library_geometries><geometry id="g"><mesh><source id="p"><float_array id="pa" count="{3 * count}">{values}'
        f'</float_array><technique_common><accessor source="#pa" count="{count}" stride="3"><param name="X" '
        'type="float"/><param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common>'
        '</source><vertices id="vs"><input semantic="POSITION" source="#p"/></vertices>'
        f'<triangles count="{len(triangles)}"><input semantic="VERTEX" source="#vs" offset="0"/>'
        f"<p>{' '.join(map(str, range(count)))}</p></triangles></mesh></geometry></library_geometries>"
        '<library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"/></node></visual_scene>'
        '</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>'
    )
