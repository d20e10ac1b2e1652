"""Properties that clients may replace: settings of a robot, and targets of joints."""

from collections.abc import Sequence
from dataclasses import replace

from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.resources.action_offer import Offer
from linked_fleet_gateway.resources.affordance import PutSetting, PutTarget
from linked_fleet_gateway.resources.annotations import annotate
from linked_fleet_gateway.resources.body_values import Setting, robot_settings
from linked_fleet_gateway.resources.description import DescriptionTemplate
from linked_fleet_gateway.resources.joint_kinds import kind_of
from linked_fleet_gateway.resources.joint_limits import limits_of
from linked_fleet_gateway.resources.property import Measurement, Property
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.shape_parameters import ShapeScope, shape_completer
from linked_fleet_rdf.graph import ANGULAR, UNITLESS, Graph, integer
from linked_fleet_rdf.vocabulary import HYBRIT, LF, SH
from linked_fleet_state.model import Joint
from linked_fleet_state.robot import Robot

ABSOLUTE = (LF.Rotate, LF.Translate)
"""The actions that move a joint to a target."""


def setting_properties(robot: Robot) -> list[Property]:
    """Return the settings of a robot that clients may change."""
    known = robot_settings(robot)

    def title(graph: Graph, iri: NamedNode, _: Measurement) -> None:
        graph.add(iri, LF.value, Literal(robot.title))
        graph.add(iri, HYBRIT.consumes, LF.TextInput)

    def scale(graph: Graph, iri: NamedNode, _: Measurement) -> None:
        graph.scalar(iri, LF.value, robot.speed_scale, UNITLESS)
        graph.add(iri, HYBRIT.consumes, LF.SpeedScaleInput)

    def annotations(graph: Graph, iri: NamedNode, _: Measurement) -> None:
        subject = iri.value.removesuffix("annotations")
        annotate(graph, NamedNode(subject), robot.annotations, subject)

    named = f"of {robot.name}"
    return [
        Property(segment, predicate, (type_,), shape, f"{words} {named}", describe, put=known[segment])
        for segment, predicate, type_, shape, words, describe in (
            # dcterms:title states the title itself (R1.5), so its property has no predicate of its own.
            ("title", HYBRIT.property, LF.TextProperty, LF.TextPropertyShape, "title", title),
            ("annotations", LF.annotations, LF.Annotations, LF.AnnotationsShape, "annotations", annotations),
            (
                "maximumSpeedScale",
                LF.maximumSpeedScale,
                LF.SpeedScale,
                LF.SpeedScaleShape,
                "maximum speed scale",
                scale,
            ),
        )
    ]


def target_segment(joint: Joint) -> str:
    """Return the path segment of the target of a joint that turns or slides."""
    return "targetRotation" if kind_of(joint).dimension is ANGULAR else "targetTranslation"


def target_property(robot: Robot, offer: Offer) -> Property:
    """Return the last target position of a joint as a property; PUT invokes ``offer``."""
    joint = offer.joint
    assert joint is not None
    dimension = kind_of(joint).dimension
    assert dimension is not None
    segment = target_segment(joint)

    def describe(graph: Graph, iri: NamedNode, _: Measurement) -> None:
        graph.scalar(iri, LF.value, robot.targets.get(joint.name), dimension.position)
        graph.add(iri, HYBRIT.consumes, NamedNode(iri.value + "/blueprint#input"))

    return Property(
        segment,
        LF.terms[segment],
        (LF.TargetPosition,),
        LF.TargetPositionShape,
        f"target of {joint.name}",
        describe,
        facts=lambda: robot.targets.get(joint.name),
        put=offer,
    )


def describe_target_input(
    graph: Graph, iri: NamedNode, offer: Offer, base: str, ends: Sequence[Literal] | None = None
) -> None:
    """Describe the shape of a target's body: one ``lf:value``, as the action takes it.

    ``ends``: literals in place of the lowest and highest position in each unit.
    """
    value, scalar = graph.blank(), graph.blank()
    graph.a(iri, SH.NodeShape)
    graph.add(iri, SH.property, value)
    graph.add(value, SH.path, LF.value)
    graph.add(value, SH.name, Literal("value"))
    graph.add(value, SH.minCount, integer(1))
    graph.add(value, SH.maxCount, integer(1))
    graph.add(value, SH.node, scalar)
    graph.a(scalar, SH.NodeShape)
    assert offer.joint is not None
    limits = limits_of(offer.joint, (LF.jointPosition,))
    if ends is not None:
        limits = replace(limits, numbers={LF.jointPosition: ends})
    shape_completer(ShapeScope(base, offer.robot, limits))(graph, scalar, LF.jointPosition)


def target_blueprint(blueprint: Resource, offer: Offer, base: str) -> Resource:
    """Return the blueprint of a target with the shape of its body, which depends on the joint."""
    kind, joint = blueprint.template, offer.joint
    assert kind is not None and joint is not None

    def positions() -> tuple[Literal, ...]:
        return tuple(limits_of(joint, (LF.jointPosition,)).numbers[LF.jointPosition])

    def describe(graph: Graph, owner: str, ends: Sequence[Literal]) -> None:
        kind.describe(graph, owner, ())
        describe_target_input(graph, NamedNode(f"{base}{owner}/blueprint#input"), offer, base, ends)

    return blueprint.replace(
        describe=DescriptionTemplate((kind.key, joint.kind), kind.owner, describe, positions),
    )


def put_affordance(put: Setting | Offer | None) -> PutSetting | PutTarget | None:
    if put is None:
        return None
    return PutSetting(put) if isinstance(put, Setting) else PutTarget(put)
