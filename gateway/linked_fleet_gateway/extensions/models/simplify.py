"""Simplification of meshes: fewer triangles by collapsed edges with the least quadric error (Garland and Heckbert).

This module loads libraries that were not made for untrusted input, so only ``simplify_process`` imports it.
"""

import io
from collections import defaultdict

import fast_simplification
import numpy as np
import trimesh

from linked_fleet_gateway.extensions.models.mesh_formats import collada_unit_m, with_plain_root
from linked_fleet_gateway.extensions.models.simplify_messages import (
    MAX_TRIANGLES,
    Simplified,
    Simplify,
    SimplifyAnswer,
    SimplifyFailed,
)
from linked_fleet_state.xml import ModelError

_LEAST_TRIANGLES = 12  # of a part of one colour: a box
_MOST_PARTS = 4_096
_MERGED_DIGITS = 5  # in metre
# From 0, which is slow, to 10. From 5 on, edges of surfaces that are not closed move by a tenth of their size.
_AGGRESSION = 3
_Colour = tuple[int, ...] | None


def simplify(question: Simplify) -> SimplifyAnswer:
    """Return the mesh with fewer triangles in binary glTF, or why that is not possible."""
    try:
        return Simplified(_exported(_parts(question)))
    except ModelError as error:
        return SimplifyFailed(str(error))
    except MemoryError:
        return SimplifyFailed("it needs too much memory")
    except Exception as error:  # noqa: BLE001 - the readers raise errors of any kind for malformed files
        return SimplifyFailed(f"it cannot be read: {error}"[:300])


def _parts(question: Simplify) -> dict[_Colour, list[trimesh.Trimesh]]:
    """Return the surfaces in metre, in the axes of the file, by their colour. Raises ModelError."""
    content = with_plain_root(question.content) if question.suffix == "glb" else question.content
    scene = trimesh.load_scene(io.BytesIO(content), file_type=question.suffix)
    unit_m = collada_unit_m(content) if question.suffix == "dae" else 1.0
    parts = defaultdict[_Colour, list[trimesh.Trimesh]](list)
    nodes = scene.graph.nodes_geometry
    if len(nodes) > _MOST_PARTS:
        raise ModelError(f"it has more than {_MOST_PARTS} parts")
    for node in nodes:
        place, name = scene.graph[node]
        surface = scene.geometry[name]
        if not isinstance(surface, trimesh.Trimesh) or not len(surface.faces):
            continue  # lines and points are not drawn
        corners = trimesh.transform_points(surface.vertices, place) * unit_m
        if not np.isfinite(corners).all():
            raise ModelError("it has numbers that are not finite")
        parts[_colour(surface, question.suffix)].append(trimesh.Trimesh(corners, surface.faces, process=False))
    if not parts:
        raise ModelError("it has no triangles")
    return parts


def _colour(surface: trimesh.Trimesh, suffix: str) -> _Colour:
    """Return RGBA from 0 to 255, or None for a file without colours of its own, which a URDF paints."""
    material = getattr(surface.visual, "material", None)
    if material is None or suffix in ("stl", "obj"):  # an OBJ has its colours in another file
        return None
    return tuple(int(each) for each in np.asarray(material.main_color))


def _exported(parts: dict[_Colour, list[trimesh.Trimesh]]) -> bytes:
    total = sum(len(each.faces) for surfaces in parts.values() for each in surfaces)
    scene = trimesh.Scene()
    for colour, surfaces in parts.items():
        whole = trimesh.util.concatenate(surfaces)
        assert isinstance(whole, trimesh.Trimesh)
        whole.merge_vertices(digits_vertex=_MERGED_DIGITS)  # a corner that is stored twice would tear the surface
        most = max(_LEAST_TRIANGLES, MAX_TRIANGLES * len(whole.faces) // total)
        if len(whole.faces) > most:
            corners, faces = fast_simplification.simplify(
                whole.vertices.astype(np.float32), whole.faces.astype(np.int32), target_count=most, agg=_AGGRESSION
            )
            whole = trimesh.Trimesh(corners, faces, process=False)
        if colour is not None:
            linear = trimesh.visual.color.srgb_to_linear(np.array(colour[:3], np.uint8))  # glTF 2.0, 5.22.2
            factor = [*linear, colour[3] / 255]
            material = trimesh.visual.material.PBRMaterial(baseColorFactor=factor)
            whole.visual = trimesh.visual.TextureVisuals(material=material)
        scene.add_geometry(whole)
    exported: bytes = scene.export(file_type="glb", include_normals=False)
    return exported
