"""Actions (paper 5.4, figures 5a and 5b): the shape that describes what an action consumes also guards it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from pyoxigraph import Literal, NamedNode

from agents.wire.messages import Move
from gateway.fleet.model import Joint, JointKind
from gateway.fleet.robot import Robot
from gateway.graph.build import Graph, Node, integer
from gateway.graph.kinds import Unit, kind_of
from gateway.graph.paths import joint_path, robot_path
from gateway.graph.shapes import closure
from gateway.graph.vocab import DCTERMS, HTTP, HYBRIT, LF, MATHS, METHODS, RDFS, SH, VOM, XSD

NUMERIC = (
    XSD.float, XSD.double, XSD.decimal, XSD.integer, XSD.int, XSD.long, XSD.short, XSD.byte,
    XSD.nonNegativeInteger, XSD.positiveInteger, XSD.nonPositiveInteger, XSD.negativeInteger,
    XSD.unsignedLong, XSD.unsignedInt, XSD.unsignedShort, XSD.unsignedByte,
)  # fmt: skip
_DIGITS = 6  # limits are rounded inwards to a millionth of the unit, so what the shape admits the robot admits


@dataclass(frozen=True)
class JointMotion:
    """The action that brings one joint to an absolute position: ``rotate`` or ``translate``."""

    robot: Robot
    joint: Joint
    name: str

    @property
    def path(self) -> str:
        return f"{joint_path(self.robot.name, self.joint.name)}/actions/{self.name}"

    @property
    def title(self) -> str:
        verb = "Rotate" if self.name == "rotate" else "Translate"
        return f"{verb} {self.joint.name} to an absolute position"

    def describe(self, graph: Graph, base: str) -> None:
        """Figure 5a, corrected: limits on the value, per unit; bound to PUT and POST."""
        iri = NamedNode(base + self.path)
        graph.a(iri, HYBRIT.Action, HYBRIT.AsynchronousAction)
        graph.add(iri, DCTERMS.title, Literal(self.title))
        graph.add(iri, RDFS.comment, Literal(self._comment()))
        graph.add(iri, RDFS.seeAlso, NamedNode(base + joint_path(self.robot.name, self.joint.name)))
        graph.add(iri, HYBRIT.consumes, consumes(graph, self.joint))
        graph.add(iri, HYBRIT.produces, NamedNode(iri.value + "/produceshape"))
        body = graph.blank(HTTP.Body)
        for method in (METHODS.PUT, METHODS.POST):
            request = graph.blank(HTTP.Request)
            graph.add(iri, HYBRIT.binding, request)
            graph.add(request, HTTP.mthd, method)
            graph.add(request, HTTP.requestURI, iri)
            graph.add(request, HTTP.body, body)
        graph.add(iri, LF.invocations, NamedNode(iri.value + "/invocations"))

    def describe_result(self, graph: Graph, base: str) -> None:
        """``hybrit:produces``: the shape of the invocation resource that an invocation creates."""
        iri = NamedNode(f"{base}{self.path}/produceshape")
        graph.a(iri, SH.NodeShape)
        graph.add(iri, DCTERMS.title, Literal(f"What {self.name} of {self.joint.name} produces"))
        graph.add(iri, SH.targetClass, LF.Invocation)
        graph.add(iri, SH.node, LF.InvocationShape)
        closure(graph, LF.InvocationShape)

    def motion(self, value: float, unit: NamedNode) -> Move:
        """The command for a value that the guard admitted, in SI; a continuous joint takes the short way."""
        target = value * next(u.si for u in units(self.joint) if unit in u.accepted)
        limits = self.joint.limits
        if self.joint.kind is JointKind.CONTINUOUS:
            present = self.robot.positions.get(self.joint.name, math.nan)
            if not math.isnan(present):
                target = present + math.remainder(target - present, math.tau)
        elif limits.lower is not None and limits.upper is not None:
            target = min(max(target, limits.lower), limits.upper)
        return Move({self.joint.name: target})

    def _comment(self) -> str:
        first, *_ = units(self.joint)
        low, high = bounds(self.joint, first)
        return (
            f"Takes a maths:Scalar with vom:numericalValue and vom:unit, from {low} to {high} in {first.qudt.value}. "
            f"The joint of robot {robot_path(self.robot.name)} moves no faster than its URDF velocity limit."
        )


def units(joint: Joint) -> Sequence[Unit]:
    dimension = kind_of(joint).dimension
    assert dimension is not None
    return dimension.accepted


def bounds(joint: Joint, unit: Unit) -> tuple[float, float]:
    """Lowest and highest admissible value in ``unit``; a continuous joint takes 0 up to, not including, one turn."""
    if joint.kind is JointKind.CONTINUOUS:
        return 0.0, round(math.tau / unit.si, _DIGITS)
    low, high = joint.limits.lower, joint.limits.upper
    assert low is not None and high is not None
    scale = 10**_DIGITS
    return math.ceil(low / unit.si * scale - 1e-3) / scale, math.floor(high / unit.si * scale + 1e-3) / scale


def consumes(graph: Graph, joint: Joint) -> Node:
    """Add the shape of the action's body: one value and one unit, and per unit one branch with the joint's limits."""
    shape = graph.blank(SH.NodeShape)
    graph.add(shape, SH.targetClass, MATHS.Scalar)
    value = _property(graph, VOM.numericalValue, "value", "the absolute position to reach")
    graph.add(value, SH.or_, graph.collection([_datatype(graph, datatype) for datatype in NUMERIC]))
    unit = _property(graph, VOM.unit, "unit", "the unit of the value")
    known = [iri for each in units(joint) for iri in each.accepted]
    graph.add(unit, SH.in_, graph.collection(known))
    graph.add(shape, SH.property, value, unit)
    graph.add(shape, SH.or_, graph.collection([branch(graph, joint, each) for each in units(joint)]))
    return shape


def branch(graph: Graph, joint: Joint, unit: Unit) -> Node:
    """The joint's limits in one unit."""
    low, high = bounds(joint, unit)
    node, limits, which = graph.blank(), graph.blank(), graph.blank()
    graph.add(which, SH.path, VOM.unit)
    graph.add(which, SH.in_, graph.collection(list(unit.accepted)))
    graph.add(limits, SH.path, VOM.numericalValue)
    graph.add(limits, SH.minInclusive, _decimal(low))
    graph.add(limits, SH.maxExclusive if joint.kind is JointKind.CONTINUOUS else SH.maxInclusive, _decimal(high))
    graph.add(node, SH.property, which, limits)
    return node


def _property(graph: Graph, path: NamedNode, name: str, description: str) -> Node:
    node = graph.blank()
    graph.add(node, SH.path, path)
    graph.add(node, SH.name, Literal(name))
    graph.add(node, SH.description, Literal(description))
    graph.add(node, SH.minCount, integer(1))
    graph.add(node, SH.maxCount, integer(1))
    return node


def _datatype(graph: Graph, datatype: NamedNode) -> Node:
    node = graph.blank()
    graph.add(node, SH.datatype, datatype)
    return node


def _decimal(value: float) -> Literal:
    text = f"{value:.{_DIGITS}f}".rstrip("0")
    return Literal(text + "0" if text.endswith(".") else text, datatype=XSD.decimal)
