"""Kinds of actions, and actions as things offer them (paper 5.4, figure 5a).

Kinds are read once from one Turtle file each in shapes/linked_fleet_shapes/actions. The shape that describes the input
of an action also validates it. A kind may state conditions on the robot under which a thing offers it
(``lf:offeredIf``).
"""

from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, islice
from typing import Any

from pyoxigraph import Literal, NamedNode, Triple

from linked_fleet_base.contributions import present
from linked_fleet_gateway.resources.annotations import named_poses
from linked_fleet_gateway.resources.form import Form, Json
from linked_fleet_gateway.resources.joint_kinds import kind_of
from linked_fleet_gateway.resources.joint_limits import JointLimits, limits_of
from linked_fleet_gateway.resources.paths import joint_path, robot_path
from linked_fleet_gateway.resources.shape_parameters import (
    ShapeScope,
    commandable_joints,
    is_bounded,
    moved_links,
    shape_completer,
)
from linked_fleet_identity.rights import Right
from linked_fleet_rdf.graph import Graph, Node
from linked_fleet_rdf.shapes import ACTIONS, add_closure, copy_shape, load_turtle
from linked_fleet_rdf.vocabulary import DCTERMS, HTTP, HYBRIT, LF, METHODS, RDF, RDFS, SH
from linked_fleet_state.model import Joint, Link
from linked_fleet_state.robot import Robot


@dataclass(frozen=True, eq=False)
class ActionDefinition:
    """A kind of action.

    ``offered_by`` are classes of things, ``offered_if`` conditions on the robot, ``capability`` is required of the
    agent.
    """

    iri: NamedNode
    segment: str
    title: str
    comment: str
    offered_by: frozenset[NamedNode]
    offered_if: tuple[NamedNode, ...]
    capability: str
    methods: tuple[NamedNode, ...]
    consumes: NamedNode | None
    produces: NamedNode
    is_stop: bool = False
    """True if it stops something: anybody with the right to stop may ask, at any rate and whoever has a lease."""
    right: Right = Right.ACT
    """The right that invoking it needs."""
    completions: frozenset[NamedNode] = frozenset()
    """The parts that ``lf:completedBy`` adds to the shape of the body for a thing."""

    @cached_property
    def method_names(self) -> tuple[str, ...]:
        """The methods that run it, sorted."""
        return tuple(sorted(("PUT" if method == METHODS.PUT else "POST") for method in self.methods))


def action_definitions() -> tuple[ActionDefinition, ...]:
    """Return all kinds, in the order of their files."""
    return present().derived("kinds of actions", _read_definitions)


def _read_definitions() -> tuple[ActionDefinition, ...]:
    shapes = load_turtle(ACTIONS)
    kinds = [node for node, triples in shapes.items() if any(t.object == LF.ActionKind for t in triples)]
    return tuple(_read(kind) for kind in kinds if isinstance(kind, NamedNode))


def _read(kind: NamedNode) -> ActionDefinition:
    said: dict[NamedNode, list[NamedNode | Literal]] = {}
    for triple in load_turtle(ACTIONS)[kind]:
        said.setdefault(triple.predicate, []).append(triple.object)  # type: ignore[arg-type]

    def text(predicate: NamedNode) -> str:
        return said[predicate][0].value if predicate in said else ""

    def named(predicate: NamedNode) -> tuple[NamedNode, ...]:
        return tuple(each for each in said.get(predicate, ()) if isinstance(each, NamedNode))

    assert RDF.type in said
    consumes = next(iter(named(HYBRIT.consumes)), None)
    is_stop = text(LF.isStop) == "true"
    return ActionDefinition(
        iri=kind,
        segment=text(LF.segment),
        title=text(DCTERMS.title),
        comment=text(RDFS.comment),
        offered_by=frozenset(named(LF.offeredBy)),
        offered_if=named(LF.offeredIf),
        capability=text(LF.capability),
        methods=named(HTTP.mthd),
        consumes=consumes,
        produces=named(HYBRIT.produces)[0],
        is_stop=is_stop,
        right=Right(text(LF.needsRight) or (Right.STOP if is_stop else Right.ACT)),
        completions=frozenset() if consumes is None else _completions(consumes),
    )


def _completions(shape: NamedNode) -> frozenset[NamedNode]:
    found: set[NamedNode] = set()
    done: set[object] = set()
    pending: list[object] = [shape]
    while pending:
        node = pending.pop()
        if node in done:
            continue
        done.add(node)
        for triple in load_turtle(ACTIONS).get(node, ()):  # type: ignore[call-overload]
            pending.append(triple.object)
            if triple.predicate == LF.completedBy and isinstance(triple.object, NamedNode):
                found.add(triple.object)
    return frozenset(found)


_FOLLOW_PATH = LF.extended("FollowPath").FollowPath
Condition = Callable[[Robot, Joint | None], bool]


def _is_bounded(robot: Robot, joint: Joint | None) -> bool:
    """Return True for a joint that has limits and is in the agent's frames, which means that it takes commands."""
    return joint is not None and is_bounded(joint) and joint.name in robot.commanded


def path_offer(robot: Robot) -> "Offer | None":
    """Return the action by which the base of a robot follows a path; None if it has none."""
    offers = (offer for part in robot.parts.values() for offer in part.offers.values())
    return next((each for each in offers if each.definition.iri == _FOLLOW_PATH), None)


CONDITIONS: dict[NamedNode, Condition] = {
    LF.isBounded: _is_bounded,
    LF.isCommandable: lambda robot, joint: joint is not None and joint.commandable and joint.name in robot.commanded,
    LF.hasCommandableJoint: lambda robot, joint: bool(commandable_joints(robot)),
    LF.hasMovedLink: lambda robot, joint: bool(moved_links(robot)),
    LF.hasNamedPose: lambda robot, joint: bool(named_poses(robot)),
    LF.hasFloatingBase: lambda robot, joint: robot.floats,
    LF.hasPathFollower: lambda robot, joint: path_offer(robot) is not None,
}


@dataclass(frozen=True)
class Offer:
    """One kind of action at the thing with the path ``thing``."""

    definition: ActionDefinition
    thing: str
    robot: Robot | None = None
    joint: Joint | None = None
    label: str = ""
    """Name of the thing, if it is neither a robot nor a part of one."""

    @cached_property
    def path(self) -> str:
        return self.path_at(self.thing)

    def path_at(self, thing: str) -> str:
        """Return the path of the same action of the thing at a path."""
        return f"{thing.rstrip('/')}/actions/{self.definition.segment}"

    @property
    def name(self) -> str:
        part = self.joint.name if self.joint else self.robot.name if self.robot else self.label or "the fleet"
        return f"{self.definition.title}: {part}"

    handler: Callable[[Any], Any] | None = None
    """Its handler, if the action has one of its own beside those of its kind."""

    @property
    def methods(self) -> tuple[str, ...]:
        return self.definition.method_names

    @property
    def needs(self) -> tuple[Right, ...]:
        """The rights, one of which invoking it needs."""
        return (self.definition.right,)

    @property
    def robots(self) -> Set[str] | None:
        """The robots that it may move or act on in another way; None for those that its body names."""
        return frozenset() if self.robot is None else frozenset({self.robot.name})

    @property
    def declared_by(self) -> str:
        """The path of the thing, if its robot has declared the action itself."""
        return ""

    @property
    def stream_protocol(self) -> str:
        """The subprotocol of a WebSocket that opens it as a stream of inputs; empty if it takes none."""
        return ""

    @property
    def body_is_optional(self) -> bool:
        """True if it also runs without a body."""
        return False

    @property
    def takes_value(self) -> bool:
        """True if its body is the ``lf:value`` of the property that it sets."""
        return False

    @property
    def outcome_members(self) -> Mapping[str, Json]:
        """The JSON Schemas of what its invocations have in plain JSON beside the members of their shape, by name."""
        return {}

    def first_body_is_slow(self, base: str) -> bool:
        """Return True if the next body takes long even if it is short, because its shape must be compiled before."""
        return False

    def input_form(self, base: str) -> Form | None:
        """Return the form of its body, if that is not the form of its shape."""
        return None

    def read_body(self, triples: Sequence[Triple], base: str) -> Any:
        """Validate a body and return its typed form, if it does so itself; else None. Raises UnprocessableContent."""
        return None

    @property
    def takes_body(self) -> bool:
        return self.definition.consumes is not None

    @property
    def is_stop(self) -> bool:
        return self.definition.is_stop

    @cached_property
    def values(self) -> tuple[Literal, ...]:
        """The literals in which its description differs from those of other joints of the robot: name and limits."""
        numbers = () if self._limits is None else self._limits.numbers.values()
        return (Literal(self.name), *chain.from_iterable(numbers))

    @cached_property
    def _limits(self) -> JointLimits | None:
        completions = self.definition.completions
        return limits_of(self.joint, completions) if self.joint is not None and completions else None

    @property
    def template_key(self) -> object:
        """Key of the offers whose descriptions differ in the thing and in ``values`` alone; None if there are none."""
        definition, robot, joint = self.definition, self.robot, self.joint
        if definition.consumes is None:
            return definition.iri
        if robot is None or robot.description is None or joint is None:
            return None
        return definition.iri, joint.kind, robot.name, robot.model, robot.commanded

    def describe(self, graph: Graph, base: str) -> None:
        """Describe the action as in figure 5a, corrected: limits on the value, per unit, and suitable methods."""
        self.describe_at(graph, base, self.thing, self.values)

    def describe_at(self, graph: Graph, base: str, thing: str, values: Sequence[Literal]) -> None:
        """Describe the same action of the thing at the path, with literals in place of ``values``."""
        iri, definition = NamedNode(base + self.path_at(thing)), self.definition
        name, *numbers = values
        graph.a(iri, HYBRIT.Action, HYBRIT.AsynchronousAction, definition.iri)
        graph.add(iri, DCTERMS.title, name)
        graph.add(iri, DCTERMS.identifier, Literal(definition.segment))
        graph.add(iri, RDFS.comment, Literal(definition.comment))
        graph.add(iri, RDFS.seeAlso, NamedNode(base + thing))
        if definition.consumes is not None:
            graph.add(iri, HYBRIT.consumes, self._consumes(graph, base, numbers))
        graph.add(iri, HYBRIT.produces, NamedNode(iri.value + "/produceshape"))
        body = graph.blank(HTTP.Body) if definition.consumes is not None else None
        for method in definition.methods:
            request = graph.blank(HTTP.Request)
            graph.add(iri, HYBRIT.binding, request)
            graph.add(request, HTTP.mthd, method)
            graph.add(request, HTTP.requestURI, iri)
            if body is not None:
                graph.add(request, HTTP.body, body)
        graph.add(iri, LF.dryRun, Literal(True))
        graph.add(iri, LF.invocations, NamedNode(iri.value + "/invocations"))

    def describe_input(self, graph: Graph, base: str) -> Node:
        """Add the shape of the body, with the limits of this thing."""
        return self._consumes(graph, base, self.values[1:])

    def _consumes(self, graph: Graph, base: str, numbers: Iterable[Literal]) -> Node:
        assert self.definition.consumes is not None
        limits = self._limits
        if limits is not None:
            given = iter(numbers)
            stated = {each: tuple(islice(given, len(own))) for each, own in limits.numbers.items()}
            limits = JointLimits(limits.dimension, limits.is_continuous, stated)
        scope = ShapeScope(base, self.robot, limits)
        return copy_shape(graph, load_turtle(ACTIONS), self.definition.consumes, shape_completer(scope))

    def result_title(self) -> Literal:
        return Literal(f"What {self.name} produces")

    def describe_result(self, graph: Graph, base: str, thing: str, title: Literal) -> None:
        """Describe ``hybrit:produces`` of the action of a thing: the shape of the invocation that is created."""
        iri = NamedNode(f"{base}{self.path_at(thing)}/produceshape")
        graph.a(iri, SH.NodeShape)
        graph.add(iri, DCTERMS.title, title)
        graph.add(iri, SH.targetClass, LF.Invocation)
        graph.add(iri, SH.node, self.definition.produces)
        add_closure(graph, self.definition.produces)


def offers_at(robot: Robot | None, part: Any = None) -> list[Offer]:
    """Return the actions of the fleet (None), of a robot, or of its joint or other part; a link has none."""
    if robot is None:
        return fleet_offers()
    if part is None:
        return robot_offers(robot)
    if isinstance(part, Joint):
        return joint_offers(robot, part)
    return [] if isinstance(part, Link) else list(part.offers.values())


def joint_offers(robot: Robot, joint: Joint, segment: str | None = None) -> list[Offer]:
    """Return the actions of a joint; none if it, or its robot, takes no commands.

    ``segment``: return only the action with this segment, if it is offered.
    """
    offered = _offered(kind_of(joint).type, robot, joint, segment)
    return [Offer(each, joint_path(robot.name, joint.name), robot, joint) for each in offered]


def robot_offers(robot: Robot, segment: str | None = None) -> list[Offer]:
    """Return the actions of a robot, or only the one with the segment, if it is offered."""
    return [Offer(each, robot_path(robot.name), robot) for each in _offered(LF.Robot, robot, None, segment)]


def fleet_offers(segment: str | None = None) -> list[Offer]:
    """Return the actions of the fleet, or only the one with the segment."""
    return [Offer(each, "/") for each in _named(segment) if LF.Fleet in each.offered_by]


def offers_of(kind: NamedNode, thing: str, label: str, segment: str | None = None) -> list[Offer]:
    """Return the actions of a thing of a class at a path, or only the one with the segment.

    The thing is neither the fleet, nor a robot, nor a part of one.
    """
    return [Offer(each, thing, label=label) for each in _named(segment) if kind in each.offered_by]


def _offered(kind: NamedNode, robot: Robot, joint: Joint | None, segment: str | None) -> list[ActionDefinition]:
    able = ("", *robot.description.capabilities) if robot.description is not None and robot.model is not None else ()
    kinds = [each for each in _named(segment) if kind in each.offered_by and each.capability in able]
    return [each for each in kinds if all(CONDITIONS[one](robot, joint) for one in each.offered_if)]


def _named(segment: str | None) -> Iterable[ActionDefinition]:
    return [each for each in action_definitions() if segment in (None, each.segment)]
