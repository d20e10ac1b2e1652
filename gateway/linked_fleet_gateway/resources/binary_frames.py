"""Binary frames and their layouts in RDF (desideratum D5): a client reads the layout once, then only values follow.

The joint state uses the unchanged frames of the robot's agent. A measured property has a small frame of its own: a
header and its numbers. The layout below each describes offsets, units and properties.
"""

import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import count
from typing import NamedTuple

from pyoxigraph import BlankNode, Literal, NamedNode

from linked_fleet_gateway.resources.describe import Describer
from linked_fleet_gateway.resources.paths import joint_path, robot_path
from linked_fleet_gateway.resources.properties import FRAME_MEDIA_TYPE, joint_properties
from linked_fleet_gateway.resources.property import Measurement, Property
from linked_fleet_gateway.resources.resource import Resource, blueprint_of
from linked_fleet_gateway.resources.versioning import Source, version_of
from linked_fleet_rdf.graph import NANOSECOND, UNITLESS, Graph, Term, integer
from linked_fleet_rdf.serialise import WriteError
from linked_fleet_rdf.vocabulary import DCTERMS, HYBRIT, LF, MATHS, QUDT, RDFS, SPATIAL, VOM
from linked_fleet_state.observation import Observation
from linked_fleet_state.robot import Robot

FRAME_TYPES = (FRAME_MEDIA_TYPE, "application/octet-stream")
"""Two media types of the same bytes: a specific and a generic one."""

Path = tuple[NamedNode, ...]


class Field(NamedTuple):
    """A field of a frame; ``meaning`` describes fields that are not measured numbers."""

    name: str
    type: str
    offset: int
    meaning: str


_MAGIC, _VERSION = b"LV", 1
_HEADER = struct.Struct("<2sHIQQq")
_XYZ = (MATHS.x, MATHS.y, MATHS.z)
_XYZW = (*_XYZ, LF.w)

_PATHS: Mapping[NamedNode, tuple[Path, ...]] = {
    SPATIAL.AxisAngleShape: ((SPATIAL.rotationAngle, VOM.numericalValue),),
    LF.TranslationShape: ((LF.displacement, VOM.numericalValue),),
    LF.ScalarPropertyShape: ((LF.value, VOM.numericalValue),),
    LF.PoseShape: (*((LF.position, axis) for axis in _XYZ), *((LF.orientation, axis) for axis in _XYZW)),
    LF.TwistShape: (*((LF.linear, axis) for axis in _XYZ), *((LF.angular, axis) for axis in _XYZ)),
}
"""By shape of a property: the paths to its measured numbers, in the order of its observation."""

_VALUE_HEADER = (
    Field("magic", "char2", 0, "The letters LV."),
    Field("version", "uint16", 2, "Of this form of frames: 1."),
    Field("change", "uint32", 4, "Of lf:version: the number after the dot, 0 where there is none."),
    Field("incarnation", "uint64", 8, "Of lf:version: the run of the agent."),
    Field("frame", "uint64", 16, "Of lf:version: the frame of the agent, counted from 1."),
    Field("time", "int64", 24, "When the value last changed, by the agent's clock: since 1970 (UTC); -1 is unknown."),
)
_STATE_HEADER = {
    "magic": "The letters LF.",
    "version": "Of this form of frames: 1.",
    "flags": "Bit 0: the base floats.",
    "joints": "How many joints there are.",
    "incarnation": "Of lf:version: the run of the agent.",
    "sequence": "The number of the frame in its run, counted from 0: one less than in lf:version.",
    "monotonic_ns": "When the values were read, by the agent's monotonic clock.",
    "wall_ns": "When the values were read, by the agent's clock: since 1970 (UTC).",
}
_TIMES = frozenset({"time", "monotonic_ns", "wall_ns"})


def has_frames(item: Property) -> bool:
    """Return True if the property has binary frames."""
    return item.predicate == LF.jointState or (item.is_measured and item.shape in _PATHS)


def layout_path(path: str) -> str:
    """Return the path of the frame layout of the property at ``path``."""
    return path + "/layout"


def related_layouts(path: str, item: Property) -> tuple[str, ...]:
    """Return the layouts to link from a thing. Single values are too many; their layouts are linked by describedby."""
    return (layout_path(path),) if item.predicate == LF.jointState else ()


def frame_writers(robot: Robot, item: Property) -> dict[str, Callable[[], bytes]]:
    """Return the frames of a property by media type. Joint state raises WriteError before the first frame."""
    if not has_frames(item):
        return {}
    whole = item.predicate == LF.jointState
    return dict.fromkeys(FRAME_TYPES, lambda: _state_frame(robot) if whole else value_frame(robot, *item.sample()))


def value_frame(robot: Robot, observation: Observation) -> bytes:
    """Return the frame of one observation: version, time, numbers; NaN is unknown."""
    incarnation, frame, change = version_of(robot, (observation,))
    wall_ns = -1 if observation.wall_ns is None else observation.wall_ns
    header = _HEADER.pack(_MAGIC, _VERSION, change, incarnation, frame, wall_ns)
    return header + struct.pack(f"<{len(observation.values)}d", *observation.values)


def _state_frame(robot: Robot) -> bytes:
    if robot.payload is None:
        raise WriteError(f"no frame of {robot.name} has come yet")
    return robot.payload


# -- layouts --------------------------------------------------------------------------------------------------------


class _Number(NamedTuple):
    """One number in a frame: its property, the path from the property to it, and its unit."""

    name: str
    of: NamedNode
    path: Path
    unit: Term


def resolve_layout(
    describer: Describer, robot: Robot, owner: str, item: Property, rest: Sequence[str]
) -> Resource | None:
    """Return the layout of the frames of a property, or its blueprint; ``rest`` are the segments below the property."""
    if not has_frames(item) or robot.description is None or rest[:1] != ["layout"]:
        return None
    path = layout_path(f"{owner.rstrip('/')}/{item.segment}")
    layout = Resource(
        path,
        f"Layout of the frames of {item.title}",
        lambda graph: _describe(graph, describer, robot, owner, item),
        source=Source(lambda: robot.description, robot=robot),
        own_paths=(path + "/blueprint",),
    )
    if rest[1:] == ["blueprint"]:
        return blueprint_of(layout, describer.base, (LF.FrameLayoutShape,))
    return None if rest[1:] else layout


def _describe(graph: Graph, say: Describer, robot: Robot, owner: str, item: Property) -> None:
    about = say.iri(f"{owner.rstrip('/')}/{item.segment}")
    iri = NamedNode(layout_path(about.value))
    if item.predicate == LF.jointState:
        header, numbers = _header_of_state(robot), _numbers_of_state(say, robot)
    else:
        header, numbers = _VALUE_HEADER, list(_numbers(say, robot, owner, item, owner.rstrip("/") + "/"))
    start = header[-1].offset + 8
    describe_layout(graph, about, f"the frames of {item.title}", start + 8 * len(numbers))
    for each in header:
        add_field(graph, iri, each)
    for offset, number in zip(count(start, 8), numbers, strict=False):
        node = _field(graph, iri, number.name, "float64", offset)
        graph.add(node, QUDT.unit, number.unit)
        graph.add(node, LF.ofProperty, number.of)
        graph.add(node, LF.valuePath, graph.collection(number.path))


def describe_layout(graph: Graph, subject: NamedNode, title: str, size: int) -> NamedNode:
    """Add a layout of binary frames of ``size`` bytes without its fields."""
    iri = NamedNode(layout_path(subject.value))
    graph.a(iri, LF.FrameLayout)
    graph.add(iri, DCTERMS.title, Literal(f"Layout of {title}"))
    graph.add(iri, DCTERMS.format, *map(Literal, FRAME_TYPES))
    graph.add(iri, RDFS.seeAlso, subject)
    graph.add(iri, HYBRIT.blueprint, LF.FrameLayoutShape, NamedNode(iri.value + "/blueprint"))
    graph.add(iri, LF.byteOrder, Literal("little-endian"))
    graph.add(iri, LF.byteSize, integer(size))
    return iri


def add_field(graph: Graph, layout: NamedNode, field: Field, count: int = 1) -> BlankNode:
    """Add a field with its meaning and, for a time, its unit."""
    node = _field(graph, layout, field.name, field.type, field.offset, count)
    graph.add(node, DCTERMS.description, Literal(field.meaning))
    if field.name in _TIMES:
        graph.add(node, QUDT.unit, NANOSECOND.qudt)
    return node


def _field(graph: Graph, layout: NamedNode, name: str, type_: str, offset: int, count: int = 1) -> BlankNode:
    node = graph.blank(LF.FrameField)
    graph.add(layout, LF.field, node)
    graph.add(node, LF.fieldName, Literal(name))
    graph.add(node, LF.fieldType, Literal(type_))
    graph.add(node, LF.byteOffset, integer(offset))
    graph.add(node, LF.valueCount, integer(count))
    return node


def _header_of_state(robot: Robot) -> tuple[Field, ...]:
    said = robot.description.layout if robot.description is not None else ()
    return tuple(
        Field(field.name, field.type, field.offset, _STATE_HEADER[field.name])
        for field in said
        if field.name in _STATE_HEADER
    )


def _numbers(say: Describer, robot: Robot, owner: str, item: Property, within: str) -> Iterator[_Number]:
    """Yield the numbers of a property with the units in its description, named by their paths below ``within``."""
    path = f"{owner.rstrip('/')}/{item.segment}"
    iri, graph = say.iri(path), Graph()
    say.property(robot, owner, item, graph, Measurement.from_observations(item.sample()))
    nodes: dict[NamedNode, object] = {t.predicate: t.object for t in graph.triples if t.subject == iri}
    units: dict[object, Term] = {
        t.subject: t.object for t in graph.triples if t.predicate == QUDT.unit and isinstance(t.object, NamedNode)
    }
    paths = _PATHS[item.shape]
    for steps in paths:
        unit = units.get(nodes[steps[0]], UNITLESS.qudt)
        which = [step.value.rpartition("#")[2] for step in steps] if len(paths) > 1 else []
        yield _Number(".".join([path.removeprefix(within), *which]), iri, steps, unit)


def _numbers_of_state(say: Describer, robot: Robot) -> list[_Number]:
    """Return the numbers in frame order: pose and twist of a floating base, then one row for each value of the
    joints.
    """
    assert robot.model is not None and robot.description is not None
    base = robot_path(robot.name)
    found: list[_Number] = []
    if robot.description.base == "floating":
        own = {item.segment: item for item in say.robot_properties(robot)}
        found = [each for item in (own["pose"], own["twist"]) for each in _numbers(say, robot, base, item, base)]
    columns = []
    for name in robot.description.joints:
        owner = joint_path(robot.name, name)
        # position, velocity and effort come first
        measured = [item for item in joint_properties(robot, robot.model.joints[name]) if has_frames(item)]
        columns.append([each for item in measured for each in _numbers(say, robot, owner, item, base)])
    return found + [each for row in zip(*columns, strict=True) for each in row]
