"""Parts of action shapes that depend on the robot: its joints, limits, links and poses.

A shape in shapes/linked_fleet_shapes/actions names the parts to add by ``lf:completedBy``.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.resources.annotations import named_poses
from linked_fleet_gateway.resources.joint_kinds import kind_of
from linked_fleet_gateway.resources.joint_limits import JointLimits, dimension_of, position_limits
from linked_fleet_gateway.resources.paths import joint_path, lease_path, link_path
from linked_fleet_rdf.graph import ANGULAR, LINEAR, Graph, Node, Term, Unit, integer
from linked_fleet_rdf.vocabulary import LF, NUMERIC, SH, VOM
from linked_fleet_state.model import Joint, JointKind
from linked_fleet_state.robot import Robot

_FAR = 1_000_000  # no joint position is beyond this, in any unit


@dataclass(frozen=True)
class ShapeScope:
    """The owner of a shape: the fleet, a robot, or a joint with these limits."""

    base: str
    robot: Robot | None = None
    limits: JointLimits | None = None

    def required_robot(self) -> Robot:
        assert self.robot is not None
        return self.robot

    def required_limits(self) -> JointLimits:
        assert self.limits is not None
        return self.limits

    def joint_iri(self, joint: str) -> NamedNode:
        return NamedNode(self.base + joint_path(self.required_robot().name, joint))


def shape_completer(scope: ShapeScope) -> Callable[[Graph, Node, NamedNode], None]:
    """Return the function that completes a shape at each ``lf:completedBy``. It raises KeyError for an unknown one."""
    return lambda graph, node, completion: COMPLETIONS[completion](graph, node, scope)


def is_bounded(joint: Joint) -> bool:
    """Return True if the joint takes commands and has limits for its shape."""
    ends = joint.kind is JointKind.CONTINUOUS or None not in (joint.limits.lower, joint.limits.upper)
    return joint.commandable and ends and kind_of(joint).dimension is not None


def commandable_joints(robot: Robot) -> list[Joint]:
    """Return the joints that actions of the robot can name."""
    joints = [] if robot.model is None else [robot.model.joints[name] for name in robot.commanded]
    return [joint for joint in joints if is_bounded(joint)]


# -- the completions ------------------------------------------------------------------------------------------------


def _any_number(graph: Graph, node: Node, scope: ShapeScope) -> None:
    graph.add(node, SH.or_, graph.collection([_with(graph, SH.datatype, datatype) for datatype in NUMERIC]))


def _joint_position(graph: Graph, node: Node, scope: ShapeScope) -> None:
    limits = scope.required_limits()
    units, numbers = limits.dimension.accepted, limits.numbers[LF.jointPosition]
    _value_and_unit(graph, node, units, "the absolute position to reach")
    branches = [
        _branch(graph, unit, low, high, open_end=limits.is_continuous)
        for unit, low, high in zip(units, numbers[::2], numbers[1::2], strict=True)
    ]
    graph.add(node, SH.or_, graph.collection(branches))


def _joint_displacement(graph: Graph, node: Node, scope: ShapeScope) -> None:
    limits = scope.required_limits()
    units, numbers = limits.dimension.accepted, limits.numbers[LF.jointDisplacement]
    _value_and_unit(graph, node, units, "how far to go, from where the joint is")
    branches = [
        _branch(graph, unit, low, high) for unit, low, high in zip(units, numbers[::2], numbers[1::2], strict=True)
    ]
    graph.add(node, SH.or_, graph.collection(branches))


def _joint_speed(graph: Graph, node: Node, scope: ShapeScope) -> None:
    limits = scope.required_limits()
    units = limits.dimension.speeds
    _value_and_unit(graph, node, units, "the highest speed")
    branches = []
    for unit, fastest in zip(units, limits.numbers[LF.jointSpeed], strict=True):
        range_ = _path(graph, VOM.numericalValue)
        graph.add(range_, SH.minExclusive, integer(0))
        graph.add(range_, SH.maxInclusive, fastest)
        branches.append(_both(graph, _unit_among(graph, unit.accepted), range_))
    graph.add(node, SH.or_, graph.collection(branches))


def _joint_target(graph: Graph, node: Node, scope: ShapeScope) -> None:
    joints = commandable_joints(scope.required_robot())
    _which_joint(graph, node, [scope.joint_iri(joint.name) for joint in joints])
    _value_and_unit(graph, node, _units(joints), "the absolute position to reach")
    branches = []
    for joint in joints:
        for unit in dimension_of(joint).accepted:
            branch = _branch(graph, unit, *position_limits(joint, unit), open_end=joint.kind is JointKind.CONTINUOUS)
            which = _path(graph, LF.ofJoint)
            graph.add(which, SH.hasValue, scope.joint_iri(joint.name))
            graph.add(branch, SH.property, which)
            branches.append(branch)
    graph.add(node, SH.or_, graph.collection(branches))


def _joint_expectation(graph: Graph, node: Node, scope: ShapeScope) -> None:
    joints = commandable_joints(scope.required_robot())
    _which_joint(graph, node, [scope.joint_iri(joint.name) for joint in joints])
    value, tolerance = _value_and_unit(graph, node, _units(joints), "where the joint must be"), _tolerance(graph, node)
    for each, low in ((value, -_FAR), (tolerance, 0)):
        graph.add(each, SH.minInclusive, integer(low))
        graph.add(each, SH.maxInclusive, integer(_FAR))
    branches = []
    for dimension in (ANGULAR, LINEAR):
        names = [scope.joint_iri(joint.name) for joint in joints if dimension_of(joint) is dimension]
        if names:
            which = _path(graph, LF.ofJoint)
            graph.add(which, SH.in_, graph.collection(names))
            accepted = [iri for unit in dimension.accepted for iri in unit.accepted]
            branches.append(_both(graph, which, _unit_among(graph, accepted)))
    graph.add(node, SH.or_, graph.collection(branches))


def _own_lease(graph: Graph, node: Node, scope: ShapeScope) -> None:
    graph.add(node, SH.in_, graph.collection([NamedNode(scope.base + lease_path(scope.required_robot().name))]))


def _own_link(graph: Graph, node: Node, scope: ShapeScope) -> None:
    robot = scope.required_robot()
    assert robot.model is not None
    model = robot.model
    iris = [NamedNode(scope.base + link_path(robot.name, model, link)) for link in moved_links(robot)]
    graph.add(node, SH.in_, graph.collection(iris))


def _own_pose(graph: Graph, node: Node, scope: ShapeScope) -> None:
    graph.add(node, SH.in_, graph.collection([Literal(name) for name in sorted(named_poses(scope.required_robot()))]))


def moved_links(robot: Robot) -> list[str]:
    """Return the links moved by joints that take commands."""
    if robot.model is None:
        return []
    model, able = robot.model, {joint.name for joint in commandable_joints(robot)}
    moved: set[str] = set()
    pending = [model.joints[name].child for name in able]
    while pending:
        link = pending.pop()
        if link not in moved:
            moved.add(link)
            pending += [model.joints[name].child for name in model.links[link].child_joints]
    return [link for link in model.links if link in moved]


COMPLETIONS: dict[NamedNode, Callable[[Graph, Node, ShapeScope], None]] = {
    LF.anyNumber: _any_number,
    LF.jointPosition: _joint_position,
    LF.jointDisplacement: _joint_displacement,
    LF.jointSpeed: _joint_speed,
    LF.jointTarget: _joint_target,
    LF.jointExpectation: _joint_expectation,
    LF.ownLease: _own_lease,
    LF.ownLink: _own_link,
    LF.ownPose: _own_pose,
}


# -- pieces of shapes -----------------------------------------------------------------------------------------------


def _value_and_unit(graph: Graph, node: Node, units: Iterable[Unit], meaning: str) -> Node:
    """Add a number and its unit, once each. Return the property shape of the number."""
    value = _once(graph, VOM.numericalValue, "value", meaning)
    graph.add(value, SH.or_, graph.collection([_with(graph, SH.datatype, datatype) for datatype in NUMERIC]))
    unit = _once(graph, VOM.unit, "unit", "the unit of the value")
    graph.add(unit, SH.in_, graph.collection([iri for each in units for iri in each.accepted]))
    graph.add(node, SH.property, value, unit)
    return value


def _tolerance(graph: Graph, node: Node) -> Node:
    tolerance = _once(graph, LF.tolerance, "tolerance", "how far off it may be, in the same unit")
    graph.add(tolerance, SH.or_, graph.collection([_with(graph, SH.datatype, datatype) for datatype in NUMERIC]))
    graph.add(node, SH.property, tolerance)
    return tolerance


def _which_joint(graph: Graph, node: Node, joints: Sequence[Term]) -> None:
    which = _once(graph, LF.ofJoint, "joint", "the joint")
    graph.add(which, SH.in_, graph.collection(joints))
    graph.add(node, SH.property, which)


def _units(joints: Iterable[Joint]) -> list[Unit]:
    return list(dict.fromkeys(unit for joint in joints for unit in dimension_of(joint).accepted))


def _branch(graph: Graph, unit: Unit, low: Literal, high: Literal, *, open_end: bool = False) -> Node:
    limits = _path(graph, VOM.numericalValue)
    graph.add(limits, SH.minInclusive, low)
    graph.add(limits, SH.maxExclusive if open_end else SH.maxInclusive, high)
    return _both(graph, _unit_among(graph, unit.accepted), limits)


def _both(graph: Graph, *properties: Node) -> Node:
    node = graph.blank()
    graph.add(node, SH.property, *properties)
    return node


def _unit_among(graph: Graph, units: Sequence[NamedNode]) -> Node:
    which = _path(graph, VOM.unit)
    graph.add(which, SH.in_, graph.collection(units))
    return which


def _once(graph: Graph, path: NamedNode, name: str, description: str) -> Node:
    node = _path(graph, path)
    graph.add(node, SH.name, Literal(name))
    graph.add(node, SH.description, Literal(description))
    graph.add(node, SH.minCount, integer(1))
    graph.add(node, SH.maxCount, integer(1))
    return node


def _path(graph: Graph, path: NamedNode) -> Node:
    return _with(graph, SH.path, path)


def _with(graph: Graph, predicate: NamedNode, value: NamedNode) -> Node:
    node = graph.blank()
    graph.add(node, predicate, value)
    return node
