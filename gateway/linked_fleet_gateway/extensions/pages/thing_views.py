"""Views of robots, joints, links and properties, beside the facts that every page shows."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pyoxigraph import BlankNode, Literal, NamedNode

from linked_fleet_base.lazy_imports import LazyModule
from linked_fleet_gateway.extensions.pages import robot_panel, texts
from linked_fleet_gateway.extensions.pages.languages import message, say, translated
from linked_fleet_gateway.extensions.pages.values import Address, Facts, Link, Number, Row, State, Time, Value, Vector
from linked_fleet_gateway.extensions.pages.views import LF, Part, constant
from linked_fleet_rdf.turtle import Subject, Term
from linked_fleet_rdf.vocabulary import DCTERMS, HYBRIT, RDF, RDFS, ROS, SOSA

if TYPE_CHECKING:
    from linked_fleet_gateway.extensions.pages import form
else:
    form = LazyModule("linked_fleet_gateway.extensions.pages.form")

AROUND = frozenset(
    {DCTERMS.title, DCTERMS.identifier, RDFS.seeAlso, HYBRIT.blueprint, HYBRIT.consumes, SOSA.resultTime}
)


@dataclass(frozen=True)
class DescribedSubject:
    """A subject with all facts about it; ``anchor`` is its id on the page."""

    anchor: str
    title: Link
    types: Sequence[Link]
    rows: Sequence[Row]


@dataclass(frozen=True)
class Plot:
    title: str
    number: Number


@dataclass(frozen=True)
class Card:
    """A property. ``number``: its value, if it has a single one; ``time``: when it was measured."""

    name: str
    link: Link
    number: Number | None
    rows: Sequence[Row]
    time: Time | None
    plots: Sequence[Plot]
    settable: bool


@dataclass(frozen=True)
class Limits:
    """The range of a joint, with both ends known, and its position."""

    lower: Number
    upper: Number
    value: Number


def describe_subject(facts: Facts, subject: Subject) -> DescribedSubject:
    if isinstance(subject, BlankNode):
        label = facts.outline.label(subject)
        return DescribedSubject(
            label, Link(say("node {label}", label=label), "", ""), facts.types(subject), facts.rows(subject)
        )
    anchor = subject.value.removeprefix(LF.iri) if subject.value.startswith(LF.iri) else ""
    return DescribedSubject(anchor, facts.link(subject), facts.types(subject), facts.rows(subject))


def card(facts: Facts, iri: NamedNode, name: str) -> Card:
    rows = facts.rows(iri, without=AROUND)
    numbers = [value for row in rows for value in row.values if isinstance(value, Number)]
    number = numbers[0] if len(numbers) == 1 and rows[0].values == numbers else None
    times = facts.values(iri, SOSA.resultTime)
    measured = isinstance(times[0], Time) if times else False
    return Card(
        name,
        Link(name, iri.value, iri.value),
        number,
        rows if number is None else rows[1:],
        times[0] if times and isinstance(times[0], Time) else None,
        list(_plots(name, rows)) if measured else [],
        form.form_of_setting(facts, iri) is not None,
    )


def _plots(name: str, rows: Iterable[Row]) -> Iterator[Plot]:
    """Yield scalars, and vectors with a unit: those without a unit are directions, which hardly ever change."""
    for row in rows:
        for value in row.values:
            if isinstance(value, Number) and value.at:
                yield Plot(name, value)
            elif isinstance(value, Vector) and value.unit:
                yield from (Plot(f"{row.label.text} {axis}", each) for axis, each in value.parts if each.at)


def cards(facts: Facts, iri: NamedNode) -> list[tuple[NamedNode, Card]]:
    """Return a thing's properties in the order of the description, named by their predicates, else by their IRIs."""
    listed = [each for each in facts.nodes(iri, HYBRIT.property) if each in facts.of]
    names: dict[Term, NamedNode] = {}
    for predicate, values in facts.of.get(iri, {}).items():
        if predicate != HYBRIT.property:
            names.update((value, predicate) for value in values)
    return [(each, card(facts, each, texts.term_in_words(names.get(each, each).value))) for each in listed]


def _leading(facts: Facts, iri: NamedNode) -> set[NamedNode]:
    """Return the predicates that lead to properties described in this document."""
    listed = set(facts.all(iri, HYBRIT.property)) & facts.of.keys()
    return {p for p, values in facts.of.get(iri, {}).items() if values and listed.issuperset(values)}


def _state(facts: Facts, iri: NamedNode, predicate: NamedNode) -> State | None:
    found = facts.values(iri, predicate)
    return found[0] if found and isinstance(found[0], State) else None


@dataclass(frozen=True)
class Presence:
    """The presence of a robot: its state, when it was last seen, and its fault."""

    state: State | None
    seen: Value | None
    fault: str


def presence(facts: Facts, iri: NamedNode) -> Presence:
    seen = facts.values(iri, LF.lastSeen)
    return Presence(_state(facts, iri, LF.presence), seen[0] if seen else None, facts.text(iri, LF.fault))


PRESENCE = frozenset({LF.presence, LF.lastSeen, LF.fault})


def actions(facts: Facts, iri: NamedNode) -> list[Link]:
    """Return links to the actions, named by the last segment in words."""
    found = [each.value for each in facts.nodes(iri, HYBRIT.action)]
    return [Link(texts.term_in_words(each), each, each) for each in found]


# -- robot ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class JointRow:
    """A joint in its robot's list. ``values``: position, velocity and effort; empty for a fixed joint."""

    link: Link
    kind: str
    values: Sequence[Number]


@dataclass(frozen=True)
class OtherPart:
    """A part that is neither joint nor link."""

    link: Link
    kind: str


@dataclass(frozen=True)
class UncheckedLink:
    """A link that checks of motions do not cover; ``mesh`` is empty if it has none."""

    link: Link
    mesh: str
    reason: str


@dataclass(frozen=True)
class NamedPose:
    """A named pose. ``link``: to the resource that has its targets, if any; ``finding``: why it is not taken."""

    name: str
    targets: Sequence[tuple[Link, Number]]
    link: Link | None = None
    finding: str = ""


def robot(facts: Facts, iri: NamedNode) -> Part:
    joints, links, others = _parts(facts, iri)
    samples = _samples(facts, facts.all(iri, LF.jointState, LF.sample))
    listed = [JointRow(facts.link(each), _kind_of_joint(facts, each), samples.get(each, ())) for each in joints]
    state = facts.one(iri, LF.jointState)
    panel = robot_panel.panel(facts, iri)
    settings = [(each, of) for each, of in cards(facts, iri) if each != state]
    more = {
        "presence": presence(facts, iri),
        "moving": [each for each in listed if each.values],
        "fixed": [each for each in listed if not each.values],
        "links": [facts.link(each) for each in links],
        "parts": [OtherPart(facts.link(each), _kind_of_joint(facts, each)) for each in others],
        "state": getattr(state, "value", ""),
        "state_time": _first(facts, state, SOSA.resultTime),
        "pose": facts.iri_of(iri, LF.pose),
        "placement": facts.iri_of(iri, LF.placement),
        "objects": constant("objects"),
        "model": _model(facts, iri),
        "tasks": [facts.link(each) for each in facts.nodes(iri, LF.currentTask)],
        "panel": panel,
        "actions": robot_panel.other_actions(actions(facts, iri), panel),
        "poses": [_pose(facts, each) for each in facts.all(iri, LF.namedPose)],
        "cards": [of for _, of in settings],
        "comment": facts.spoken(iri, RDFS.comment),
        "unchecked": unchecked_links(facts, iri),
    }
    shown = PRESENCE | {
        LF.unchecked,
        DCTERMS.hasPart,
        HYBRIT.property,
        HYBRIT.action,
        LF.currentTask,
        LF.namedPose,
        RDFS.comment,
    }
    properties = set(facts.nodes(iri, HYBRIT.property))
    kept = set(facts.nodes(iri, LF.namedPose))
    return Part(more, shown | _leading(facts, iri), {*joints, *links, *others, *properties, *kept})


def unchecked_links(facts: Facts, iri: NamedNode) -> list[UncheckedLink]:
    """Return the links that a check does not cover, in the order of the description."""
    nodes = [each for each in facts.all(iri, LF.unchecked) if isinstance(each, BlankNode)]
    return [
        UncheckedLink(facts.link(link), facts.text(each, LF.meshUri), facts.text(each, LF.reason))
        for each in nodes
        if isinstance(link := facts.one(each, LF.ofLink), NamedNode)
    ]


def _parts(facts: Facts, iri: NamedNode) -> tuple[list[NamedNode], list[NamedNode], list[NamedNode]]:
    """Return joints, links and other parts."""
    parts = facts.nodes(iri, DCTERMS.hasPart)
    links = [each for each in parts if facts.is_a(each, ROS.Link)]
    joints = [each for each in parts if facts.is_a(each, LF.Joint)]
    known = {*links, *joints}
    return joints, links, [each for each in parts if each not in known]


def _kind_of_joint(facts: Facts, iri: NamedNode) -> str:
    types = [each for each in facts.all(iri, RDF.type) if each not in (HYBRIT.RoboticThing, LF.Joint)]
    return translated(texts.english_words(types[-1].value).removesuffix(" joint")) if types else ""


def _samples(facts: Facts, samples: Iterable[Term]) -> dict[NamedNode, list[Number]]:
    """Return position, velocity and effort by joint; addresses lead backwards from the joint to its samples."""
    found: dict[NamedNode, list[Number]] = {}
    for sample in samples:
        joint = facts.one(sample, LF.ofJoint)
        if isinstance(joint, NamedNode):
            at = Address(joint.value, f"^{LF.ofJoint.value}")
            found[joint] = [_sampled(facts, sample, at, *terms) for terms in _SAMPLED]
    return found


_SAMPLED = (
    (LF.position, LF.positionUnit),
    (LF.velocity, LF.velocityUnit),
    (LF.effort, LF.effortUnit),
)


def _sampled(facts: Facts, sample: Term, at: Address, predicate: NamedNode, unit: NamedNode) -> Number:
    value = facts.one(sample, predicate) or LF.unknown
    return facts.number(value, at.child(predicate), facts.iri_of(sample, unit))


def _pose(facts: Facts, node: Term) -> NamedPose:
    if isinstance(node, NamedNode):
        link = facts.link(node)
        return NamedPose(link.text, (), link, facts.text(node, LF.finding))
    targets = [
        (facts.link(joint), facts.scalar(each, None))
        for each in facts.all(node, LF.target)
        if isinstance(joint := facts.one(each, LF.ofJoint), NamedNode)
    ]
    return NamedPose(facts.text(node, DCTERMS.title) if isinstance(node, BlankNode) else "", targets)


def _model(facts: Facts, iri: NamedNode) -> str:
    """Return the path of the model, also of one that is still to come; empty if a described robot has none."""
    stated = facts.one(iri, LF.model)
    awaited = facts.one(iri, LF.rootLink) is None
    return path_below(getattr(stated, "value", f"{iri.value}model"), facts.root) if stated or awaited else ""


def _first(facts: Facts, subject: Term | None, predicate: NamedNode) -> Value | None:
    found = facts.values(subject, predicate) if isinstance(subject, NamedNode) else []
    return found[0] if found else None


def path_below(iri: str, root: str) -> str:
    return "/" + iri.removeprefix(root)


# -- joint, link, property ------------------------------------------------------------------------------------------


def joint(facts: Facts, iri: NamedNode) -> Part:
    found = cards(facts, iri)
    measured = [(each, of) for each, of in found if of.time is not None]
    more = {
        "presence": presence(facts, iri),
        "lead": measured[0][1] if measured else None,
        "measured": [of for _, of in measured[1:]],
        "cards": [of for _, of in found if of.time is None],
        "limits": _limits(facts, iri, measured[0][1].number if measured else None),
        "actions": actions(facts, iri),
    }
    return Part(more, _of_part(facts, iri), {each for each, _ in found} | _neighbours(facts, iri))


def link(facts: Facts, iri: NamedNode) -> Part:
    found = cards(facts, iri)
    more = {
        "presence": presence(facts, iri),
        "measured": [of for _, of in found if of.time is not None],
        "cards": [of for _, of in found if of.time is None],
    }
    return Part(more, _of_part(facts, iri), {each for each, _ in found} | _neighbours(facts, iri))


def _of_part(facts: Facts, iri: NamedNode) -> set[NamedNode]:
    return {*PRESENCE, HYBRIT.property, HYBRIT.action, *_leading(facts, iri)}


def _neighbours(facts: Facts, iri: NamedNode) -> set[Subject]:
    """Return things that have only a type and a title, which serve as texts of links."""
    return {
        each
        for each, said in facts.of.items()
        if each != iri and isinstance(each, NamedNode) and said.keys() == {RDF.type, DCTERMS.title}
    }


def _limits(facts: Facts, iri: NamedNode, value: Number | None) -> Limits | None:
    ends = [
        facts.scalar(node, None) for term in (LF.lowerLimit, LF.upperLimit) for node in facts.all(iri, LF.limits, term)
    ]
    if value is None or len(ends) != 2 or not all(each.value for each in ends):
        return None
    return Limits(ends[0], ends[1], value)


def property_(facts: Facts, iri: NamedNode) -> Part:
    own = card(facts, iri, facts.text(iri, DCTERMS.title))
    shown: set[NamedNode] = {*PRESENCE, *AROUND}
    if own.number is not None or own.time is not None:
        shown = set(facts.of.get(iri, {})) - {RDFS.seeAlso, HYBRIT.consumes}
    return Part({"presence": presence(facts, iri), "card": own, "form": form.form_of_setting(facts, iri)}, shown)


@dataclass(frozen=True)
class Annotation:
    """A statement about a robot; ``statement`` is it in N-Triples, empty if it leads to others."""

    row: Row
    statement: str


def annotations(facts: Facts, iri: NamedNode) -> Part:
    """Return the statements about the robot, each by itself, and what a form offers to say of it."""
    robot = NamedNode(iri.value.removesuffix("annotations"))
    said = [
        Annotation(
            Row(facts.term(predicate), [facts.value(each, predicate, None)]),
            f"{robot} {predicate} {each} ." if isinstance(each, NamedNode | Literal) else "",
        )
        for predicate in facts.of.get(robot, {})
        for each in facts.all(robot, predicate)
    ]
    offered = [(each.value, translated(label)) for each, label in _ANNOTATIONS.items()]
    more = {"presence": presence(facts, iri), "annotations": said, "offered": offered, "robot": robot.value}
    return Part(more, {*PRESENCE, *AROUND}, {robot})


_SCHEMA = "https://schema.org/"
_ANNOTATIONS = {
    RDFS.comment: message("Comment"),
    NamedNode(_SCHEMA + "serialNumber"): message("Serial number"),
    NamedNode(_SCHEMA + "manufacturer"): message("Manufacturer"),
    NamedNode(_SCHEMA + "location"): message("Location"),
}
"""Terms for what people mostly say of robots, with their labels."""


def joint_state(facts: Facts, iri: NamedNode) -> Part:
    samples = _samples(facts, facts.all(iri, LF.sample))
    more = {
        "presence": presence(facts, iri),
        "joints": [JointRow(facts.link(each), "", numbers) for each, numbers in samples.items()],
        "time": _first(facts, iri, SOSA.resultTime),
    }
    return Part(more, {*PRESENCE, *AROUND, LF.sample})
