"""Properties (paper 5.2): those of each kind of thing, and their descriptions with present values."""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial

from pyoxigraph import Literal, NamedNode

from linked_fleet_agent.wire.messages import Base
from linked_fleet_gateway.resources.action_offer import joint_offers
from linked_fleet_gateway.resources.joint_kinds import (
    EFFORT_RESOLUTION,
    POSE_RESOLUTION,
    POSITION_RESOLUTION,
    VELOCITY_RESOLUTION,
    kind_of,
)
from linked_fleet_gateway.resources.part import RobotPart
from linked_fleet_gateway.resources.paths import joint_path, robot_path
from linked_fleet_gateway.resources.property import Measurement, Property, Sampler, added_robot_properties
from linked_fleet_gateway.resources.settable import (
    ABSOLUTE,
    setting_properties,
    target_property,
    target_segment,
)
from linked_fleet_rdf.graph import (
    KILOGRAM,
    KILOGRAM_SQUARE_METRE,
    METRE,
    METRE_PER_SECOND,
    RADIAN,
    RADIAN_PER_SECOND,
    UNITLESS,
    Dimension,
    Graph,
    Node,
    Unit,
    integer,
    number,
)
from linked_fleet_rdf.vocabulary import DCTERMS, LF, MATHS, ROS, SPATIAL, XSD
from linked_fleet_state.model import Joint, Link, Pose
from linked_fleet_state.observation import Mark, Observation
from linked_fleet_state.robot import Robot, Row

FRAME_MEDIA_TYPE = "application/vnd.linked-fleet.frame"


def scalar(segment: str, predicate: NamedNode, title: str, value: float | None, unit: Unit) -> Property:
    """Return a property with a constant of the URDF."""

    def describe(graph: Graph, iri: NamedNode, _: Measurement) -> None:
        graph.scalar(iri, LF.value, value, unit)

    return Property(segment, predicate, (LF.ScalarProperty,), LF.ScalarPropertyShape, title, describe)


_RESOLUTIONS: Mapping[Row, float] = {
    "positions": POSITION_RESOLUTION, "velocities": VELOCITY_RESOLUTION, "efforts": EFFORT_RESOLUTION,
}  # fmt: skip


def _sampler(robot: Robot, joint: Joint, row: Row) -> Sampler:
    """Return the sampler of a measured value of a joint. All documents that show one share the same observation."""
    name, resolution = joint.name, _RESOLUTIONS[row]
    return lambda: (robot.observe_joint(name, row, resolution),)


def _measured(segment: str, predicate: NamedNode, joint: Joint, sampler: Sampler, unit: Unit) -> Property:
    """Return a property with a measured scalar of a joint and the time of its frame."""

    def describe(graph: Graph, iri: NamedNode, seen: Measurement) -> None:
        graph.scalar(iri, LF.value, seen.values[0], unit)
        graph.result_time(iri, seen.wall_ns)

    title, shape = f"{segment} of {joint.name}", LF.ScalarPropertyShape
    return Property(segment, predicate, (LF.ScalarProperty,), shape, title, describe, sampler)


def _mark(graph: Graph, node: Node, mark: Mark, base: str, robot: Robot, joint: Joint) -> None:
    """Say that a position is outside its limits, or derived from the joint that this one mimics."""
    if mark == "outside":
        graph.add(node, LF.outOfLimits, Literal("true", datatype=XSD.boolean))
    elif mark == "derived" and joint.mimic is not None:
        graph.add(node, LF.derivedFrom, NamedNode(base + joint_path(robot.name, joint.mimic.joint)))


def _base_of(iri: NamedNode, robot: Robot, joint: Joint, segment: str) -> str:
    return iri.value[: -len(f"{joint_path(robot.name, joint.name)}/{segment}")]


_Makers = dict[str, Callable[[], Property]]
"""Functions that make the properties of a thing, by segment."""


def _made(makers: _Makers, segment: str | None) -> list[Property]:
    if segment is None:
        return [make() for make in makers.values()]
    return [makers[segment]()] if segment in makers else []


def joint_properties(robot: Robot, joint: Joint, segment: str | None = None) -> list[Property]:
    """Return the properties of a joint, or only the one with the segment, if there is one."""
    kind, name = kind_of(joint), joint.name
    makers: _Makers = {}
    if kind.dimension is not None:
        assert kind.position is not None
        dimension, unit = kind.dimension, kind.dimension.velocity
        moved = _rotation if kind.position == "rotation" else _translation
        makers = {
            kind.position: lambda: moved(robot, joint),
            "velocity": lambda: _measured("velocity", LF.velocity, joint, _sampler(robot, joint, "velocities"), unit),
            "effort": lambda: _measured(
                "effort", LF.effort, joint, _sampler(robot, joint, "efforts"), dimension.effort
            ),
            "limits": lambda: _limits(robot, joint, dimension),
            "friction": lambda: scalar(
                "friction", ROS.friction, f"static friction of {name}", joint.friction, dimension.effort
            ),
            "damping": lambda: scalar("damping", LF.damping, f"damping of {name}", joint.damping, dimension.damping),
        }
    elif kind.type != LF.FixedJoint:
        # A floating or planar joint inside the tree is not in the wire's arrays, so its pose is unknown.
        makers["pose"] = lambda: _pose_property("pose", f"pose of {name}", lambda: None, robot, f"{name}/pose")
    if segment in (None, target_segment(joint)):
        for offer in joint_offers(robot, joint):
            if offer.definition.iri in ABSOLUTE:
                makers[target_segment(joint)] = partial(target_property, robot, offer)
    makers["jointReferenceFrame"] = lambda: _reference_frame(robot, joint)
    if joint.mimic is not None:
        makers["mimic"] = lambda: _mimic(robot, joint)
    return _made(makers, segment)


def link_properties(robot: Robot, link: Link, segment: str | None = None) -> list[Property]:
    """Return the properties of a link, or only the one with the segment, if there is one."""
    inertial = link.inertial

    def centre(graph: Graph, iri: NamedNode, _: Measurement) -> None:
        graph.vector(iri, LF.position, inertial.centre_m if inertial else None, METRE)

    def inertia(graph: Graph, iri: NamedNode, _: Measurement) -> None:
        moments = (inertial.inertia_kg_m2 if inertial else None) or (None,) * 6
        for term, value in zip((LF.ixx, LF.ixy, LF.ixz, LF.iyy, LF.iyz, LF.izz), moments, strict=True):
            graph.scalar(iri, term, value, KILOGRAM_SQUARE_METRE)

    name, pose = link.name, partial(robot.link_pose, link.name)
    makers: _Makers = {
        "pose": lambda: _pose_property("pose", f"pose of {name}", pose, robot, f"{name}~link/pose"),
        "mass": lambda: scalar("mass", LF.mass, f"mass of {name}", inertial.mass_kg if inertial else None, KILOGRAM),
        "centreOfMass": lambda: Property(
            "centreOfMass",
            LF.centreOfMass,
            (LF.Point,),
            LF.PointShape,
            f"centre of mass of {name}, in its frame",
            centre,
        ),
        "inertia": lambda: Property(
            "inertia",
            LF.inertia,
            (LF.Inertia,),
            LF.InertiaShape,
            f"inertia of {name} about its centre of mass",
            inertia,
        ),
    }
    return _made(makers, segment)


def properties_at(base: str, robot: Robot | None, part: Joint | Link | RobotPart | None = None) -> list[Property]:
    """Return the properties of a robot, or of a part of it, under a base URL; the fleet (None) has none."""
    if robot is None or robot.model is None:
        return []
    if part is None:
        return robot_properties(robot, lambda path: NamedNode(base + path))
    if isinstance(part, Joint):
        return joint_properties(robot, part)
    return link_properties(robot, part) if isinstance(part, Link) else list(part.properties(base))


def robot_properties(robot: Robot, iri_of: Callable[[str], NamedNode]) -> list[Property]:
    found = [
        Property(
            "jointState",
            LF.jointState,
            (LF.JointState,),
            LF.JointStateShape,
            f"joint state of {robot.name}",
            lambda graph, iri, seen: _joint_state(graph, iri, robot, iri_of, seen),
            lambda: _joint_values(robot),
        )
    ]
    found += [*setting_properties(robot), *(make(robot) for make in added_robot_properties())]
    if robot.floats:
        found.append(
            _pose_property("pose", f"pose of the base of {robot.name}", lambda: _base_pose(robot), robot, "pose")
        )
        found.append(
            Property(
                "twist",
                LF.twist,
                (LF.Twist,),
                LF.TwistShape,
                f"twist of the base of {robot.name}",
                _twist,
                lambda: (_base_twist(robot),),
            )
        )
    return found


def _rotation(robot: Robot, joint: Joint) -> Property:
    def describe(graph: Graph, iri: NamedNode, seen: Measurement) -> None:
        graph.scalar(iri, SPATIAL.rotationAngle, seen.values[0], RADIAN)
        _mark(graph, iri, next(iter(seen.marks), ""), _base_of(iri, robot, joint, "rotation"), robot, joint)
        graph.vector(iri, SPATIAL.rotationAxis, joint.axis, None)
        graph.result_time(iri, seen.wall_ns)

    types, title = (SPATIAL.AxisAngle, SPATIAL.Rotation3D), f"rotation of {joint.name}"
    sampler = _sampler(robot, joint, "positions")
    return Property("rotation", ROS.rotation, types, SPATIAL.AxisAngleShape, title, describe, sampler)


def _translation(robot: Robot, joint: Joint) -> Property:
    def describe(graph: Graph, iri: NamedNode, seen: Measurement) -> None:
        graph.scalar(iri, LF.displacement, seen.values[0], METRE)
        _mark(graph, iri, next(iter(seen.marks), ""), _base_of(iri, robot, joint, "translation"), robot, joint)
        graph.vector(iri, LF.translationAxis, joint.axis, None)
        graph.result_time(iri, seen.wall_ns)

    title, sampler = f"translation of {joint.name}", _sampler(robot, joint, "positions")
    return Property("translation", LF.translation, (LF.Translation,), LF.TranslationShape, title, describe, sampler)


def _limits(robot: Robot, joint: Joint, dimension: Dimension) -> Property:
    limits = joint.limits

    def tolerance() -> float | None:
        return None if robot.description is None else robot.description.tolerances.get(joint.name)

    def describe(graph: Graph, iri: NamedNode, _: Measurement) -> None:
        graph.scalar(iri, LF.lowerLimit, limits.lower, dimension.position)
        graph.scalar(iri, LF.upperLimit, limits.upper, dimension.position)
        graph.scalar(iri, LF.velocityLimit, limits.velocity, dimension.velocity)
        graph.scalar(iri, LF.effortLimit, limits.effort, dimension.effort)
        graph.scalar(iri, LF.arrivalTolerance, tolerance(), dimension.position)

    title = f"limits of {joint.name}"
    return Property("limits", LF.limits, (LF.Limits,), LF.LimitsShape, title, describe, facts=tolerance)


def _reference_frame(robot: Robot, joint: Joint) -> Property:
    def describe(graph: Graph, iri: NamedNode, _: Measurement) -> None:
        graph.vector(iri, LF.origin, joint.origin.position_m, METRE)
        graph.quaternion(iri, LF.orientation, joint.origin.orientation_xyzw)

    title = f"reference frame of {joint.name}, in the frame of {joint.parent}"
    return Property(
        "jointReferenceFrame",
        ROS.jointReferenceFrame,
        (MATHS.CoordinateSystem,),
        MATHS.CoordinateSystemShape,
        title,
        describe,
    )


def _mimic(robot: Robot, joint: Joint) -> Property:
    mimic = joint.mimic
    assert mimic is not None
    dimension = kind_of(joint).dimension

    def describe(graph: Graph, iri: NamedNode, _: Measurement) -> None:
        base = _base_of(iri, robot, joint, "mimic")
        graph.add(iri, LF.mimicsJoint, NamedNode(base + joint_path(robot.name, mimic.joint)))
        graph.scalar(iri, LF.multiplier, mimic.multiplier, UNITLESS)
        graph.scalar(iri, LF.offset, mimic.offset, dimension.position if dimension else UNITLESS)

    return Property("mimic", LF.mimic, (LF.Mimicry,), LF.MimicryShape, f"what {joint.name} follows", describe)


def _pose_property(segment: str, title: str, pose: Callable[[], Pose | None], robot: Robot, key: str) -> Property:
    def observe() -> Observation:
        present = pose()
        values: Sequence[float] = (
            (math.nan,) * 7 if present is None else (*present.position_m, *present.orientation_xyzw)
        )
        return robot.observe(key, tuple(values), POSE_RESOLUTION)

    def describe(graph: Graph, iri: NamedNode, seen: Measurement) -> None:
        graph.vector(iri, LF.position, seen.values[:3], METRE)
        graph.quaternion(iri, LF.orientation, seen.values[3:])
        graph.add(iri, LF.frame, Literal("world" if robot.floats else "base"))
        graph.result_time(iri, seen.wall_ns)

    return Property(segment, LF.pose, (LF.Pose,), LF.PoseShape, title, describe, lambda: (observe(),))


def _base(robot: Robot) -> Base | None:
    return None if robot.frame is None else robot.frame.base


def _base_pose(robot: Robot) -> Pose | None:
    base = _base(robot)
    return None if base is None else Pose(base.position_m, base.orientation_xyzw)


def _base_twist(robot: Robot) -> Observation:
    base = _base(robot)
    values = (math.nan,) * 6 if base is None else (*base.linear_m_s, *base.angular_rad_s)
    return robot.observe("twist", values, VELOCITY_RESOLUTION)


def _twist(graph: Graph, iri: NamedNode, seen: Measurement) -> None:
    graph.vector(iri, LF.linear, seen.values[:3], METRE_PER_SECOND)
    graph.vector(iri, LF.angular, seen.values[3:], RADIAN_PER_SECOND)
    graph.result_time(iri, seen.wall_ns)


def _movable(robot: Robot) -> list[Joint]:
    """Return the joints of the wire's arrays, in order."""
    if robot.model is None or robot.description is None:
        return []
    joints = [robot.model.joints[name] for name in robot.description.joints]
    return [joint for joint in joints if kind_of(joint).dimension is not None]


def _joint_values(robot: Robot) -> tuple[Observation, ...]:
    """Return position, velocity and effort of each joint."""
    rows = _RESOLUTIONS.items()
    return tuple([robot.observe_joint(joint.name, *row) for joint in _movable(robot) for row in rows])


def _joint_state(
    graph: Graph, iri: NamedNode, robot: Robot, iri_of: Callable[[str], NamedNode], seen: Measurement
) -> None:
    """Describe the values of every joint that frames contain, and the layout of the binary frame (D5)."""
    unmarked: Mark = ""
    marks = seen.marks[::3] or (unmarked,) * (len(seen.values) // 3)
    rows = zip(seen.values[::3], seen.values[1::3], seen.values[2::3], marks, strict=True)
    base = iri.value[: -len(f"{robot_path(robot.name)}jointState")]
    for joint, (position, velocity, effort, mark) in zip(_movable(robot), rows, strict=True):
        dimension = kind_of(joint).dimension
        assert dimension is not None
        sample = graph.blank(LF.JointSample)
        graph.add(iri, LF.sample, sample)
        graph.add(sample, LF.ofJoint, iri_of(joint_path(robot.name, joint.name)))
        _mark(graph, sample, mark, base, robot, joint)
        for predicate, value, unit_term, unit in (
            (LF.position, position, LF.positionUnit, dimension.position),
            (LF.velocity, velocity, LF.velocityUnit, dimension.velocity),
            (LF.effort, effort, LF.effortUnit, dimension.effort),
        ):
            graph.add(sample, predicate, number(value))
            graph.add(sample, unit_term, unit.qudt)
    graph.result_time(iri, seen.wall_ns)
    _layout(graph, iri, robot)


def _layout(graph: Graph, iri: NamedNode, robot: Robot) -> None:
    graph.add(iri, DCTERMS.format, Literal(FRAME_MEDIA_TYPE))
    fields = []
    for entry in robot.description.layout if robot.description else ():
        node = graph.blank(LF.FrameField)
        graph.add(node, LF.fieldName, Literal(entry.name))
        graph.add(node, LF.fieldType, Literal(entry.type))
        graph.add(node, LF.byteOffset, integer(entry.offset))
        graph.add(node, LF.valueCount, integer(entry.count))
        fields.append(node)
    graph.add(iri, LF.frameLayout, graph.collection(fields))
