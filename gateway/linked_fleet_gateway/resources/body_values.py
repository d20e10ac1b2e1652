"""Typed values of validated bodies: of actions, in SI units, and of settings of a robot.

The shape guarantees that required values exist. Settings by clients (title, annotations, maximum speed scale) are
converted from bodies to records.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain
from urllib.parse import urlsplit

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from linked_fleet_base.contributions import present
from linked_fleet_base.errors import UnprocessableContent
from linked_fleet_gateway.resources.annotations import agent_statements, read_annotations
from linked_fleet_gateway.resources.paths import robot_path
from linked_fleet_rdf.graph import UNITS, Node
from linked_fleet_rdf.shapes import BLUEPRINTS, load_turtle
from linked_fleet_rdf.validation import (
    COMMON_TYPES,
    ShaclValidator,
    Terms,
    find_root,
    refuse_statements,
    statements_by_subject,
    unused_statements,
)
from linked_fleet_rdf.vocabulary import HYBRIT, LDP, LF, MATHS, PROV, RDF, ROS, SH, SOSA, SPATIAL, VOM
from linked_fleet_state.robot import Robot

ROOT = BlankNode("input")
"""The root of a stored body."""
_MAX_REMEMBERED = 32 * 1024  # characters; a longer body is executed but not shown with the invocation
_OURS = tuple(each.iri for each in (HYBRIT, LDP, LF, MATHS, PROV, ROS, SH, SOSA, SPATIAL, VOM))
_NOT_ZERO = re.compile(r"[^eE]*[1-9]")  # a non-zero digit before the exponent


class Body:
    """The triples of a body by subject and predicate, and its root node."""

    def __init__(self, triples: Sequence[Triple], root: Node) -> None:
        self.root = root
        self.triples = triples
        self._values: dict[tuple[Node, NamedNode], list[Node | Literal]] = {}
        for triple in dict.fromkeys(triples):
            self._values.setdefault((triple.subject, triple.predicate), []).append(triple.object)  # type: ignore[arg-type]

    def nodes(self, subject: Node, predicate: NamedNode) -> list[Node]:
        return [each for each in self._values.get((subject, predicate), ()) if isinstance(each, NamedNode | BlankNode)]

    def node(self, subject: Node, predicate: NamedNode) -> Node | None:
        return next(iter(self.nodes(subject, predicate)), None)

    def address(self, subject: Node, predicate: NamedNode) -> tuple[str, str]:
        """Return an IRI in two parts: scheme and authority, and the path. The latter is empty if it is no such IRI.

        Only the gateway knows if the former is its own.
        """
        return next(iter(self.addresses(subject, predicate)), ("", ""))

    def addresses(self, subject: Node, predicate: NamedNode) -> list[tuple[str, str]]:
        """Return each IRI in two parts, likewise."""
        nodes = self.nodes(subject, predicate)
        return [_in_two(each.value if isinstance(each, NamedNode) else "") for each in nodes]

    def text(self, subject: Node, predicate: NamedNode) -> str | None:
        found = self._values.get((subject, predicate), ())
        return next((each.value for each in found if isinstance(each, Literal)), None)

    def number(self, subject: Node, predicate: NamedNode, unit: float = 1.0) -> float | None:
        """Return a number in ``unit`` converted to SI.

        Raises UnprocessableContent for a non-zero number that a float rounds to zero: a shape accepts a speed of
        1e-400, but zero would mean something else.
        """
        text = self.text(subject, predicate)
        try:
            value = None if text is None else float(text) * unit
        except ValueError as error:  # if no shape has validated it
            raise UnprocessableContent(f"{text!r:.80} of {predicate.value} is no number.") from error
        if text is not None and value == 0.0 and _NOT_ZERO.match(text):
            raise UnprocessableContent(f"{text[:80]} of {predicate.value} is too near zero; write 0 or more.")
        return value

    def unit(self, subject: Node) -> float:
        """Return the SI size of the unit that ``subject`` states; 1 without a unit."""
        unit = self.node(subject, VOM.unit)
        return UNITS[unit].si if isinstance(unit, NamedNode) else 1.0

    def quantity(self, subject: Node) -> float:
        """Return ``vom:numericalValue`` converted to the SI unit."""
        value = self.number(subject, VOM.numericalValue, self.unit(subject))
        assert value is not None
        return value


def _in_two(iri: str) -> tuple[str, str]:
    try:
        path = urlsplit(iri).path
    except ValueError:
        path = ""
    return (iri.removesuffix(path), path) if iri.endswith(path) else (iri, "")


def own_statements(triples: Sequence[Triple], root: Node) -> list[Triple]:
    """Return the triples about the root and about the blank nodes that it leads to."""
    by_subject = statements_by_subject(triples)
    found: list[Triple] = []
    pending, done = [root], set[Node]()
    while pending:
        node = pending.pop()
        if node in done:
            continue
        done.add(node)
        found += by_subject.get(node, ())
        pending += [t.object for t in by_subject.get(node, ()) if isinstance(t.object, BlankNode)]
    return found


def input_ntriples(body: Body) -> str:
    """Return the triples about the root and the blank nodes below it, as N-Triples about ``_:input``.

    Empty if it is too long to store. Types of our own vocabularies are omitted: they follow from the position of a
    node, and a validator would take a part of an input for a thing.
    """
    root, name = body.root, str(ROOT)
    lines: list[str] = []
    for triple in own_statements(body.triples, root):
        if not _is_type(triple):
            subject, predicate, value = triple
            # A term as a string is that of N-Triples.
            lines.append(f"{name if subject == root else subject} {predicate} {name if value == root else value} .\n")
    written = "".join(lines)
    return written if len(written.encode()) <= _MAX_REMEMBERED else ""


def _is_type(triple: Triple) -> bool:
    value = triple.object
    return triple.predicate == RDF.type and isinstance(value, NamedNode) and value.value.startswith(_OURS)


@dataclass(frozen=True)
class Setting:
    """One setting of one robot; ``shape`` validates its body. Annotations have neither a shape nor a form."""

    robot: Robot
    name: str
    shape: NamedNode | None = None
    read: Callable[[Body], str] | None = None
    removable: bool = False
    """True if clients may remove it by DELETE."""
    heeds_lease: bool = True
    """False if it can be changed whoever has control of the robot."""
    decides_checks: bool = False
    """True if checks of motions depend on it: the response to a change waits for the guards."""

    @property
    def path(self) -> str:
        return robot_path(self.robot.name) + self.name

    def validate(self, triples: Sequence[Triple], base: str, current: frozenset[Triple] = frozenset()) -> str:
        """Return the value to store in place of ``current``. Raises UnprocessableContent for an unusable body."""
        iri = base + self.path
        if self.shape is None or self.read is None:
            return read_annotations(triples, self.robot, base, iri, current)
        return self.read(validate_body(triples, self.shape, iri, current))

    def managed_statements(self, description: Sequence[Triple], base: str) -> list[Triple]:
        """Return the statements of its description that clients cannot remove."""
        iri = base + self.path
        if self.shape is None:
            return agent_statements(description, self.robot, base, iri)
        return managed_statements(description, self.shape, iri)


def managed_statements(description: Sequence[Triple], shape: NamedNode, iri: str) -> list[Triple]:
    """Return the statements in a description of ``iri`` that the shape of a body does not cover."""
    _, terms = _validator(shape)
    models = [each for each in description if each.predicate == RDF.type and each.object in COMMON_TYPES]
    return [*unused_statements(description, NamedNode(iri), terms), *models]


def validate_body(
    triples: Sequence[Triple], shape: NamedNode, iri: str, current: frozenset[Triple] = frozenset()
) -> Body:
    """Validate a body for ``iri``, which ``current`` describes as it is.

    Raises UnprocessableContent if the blueprint's shape refuses it, or does not cover a part of it that is not
    ``current``.
    """
    focus = find_root(triples, NamedNode(iri))
    validator, terms = _validator(shape)
    found = validator.report(triples, focus)
    constraint = f"{iri}/blueprint"
    if found is not None:
        detail, report = found
        raise UnprocessableContent(
            f"The body does not conform to the blueprint: {detail}", report=report, constraint=constraint
        )
    refuse_statements(unused_statements(triples, focus, terms, current), constraint)
    return Body(triples, focus)


def robot_settings(robot: Robot) -> dict[str, Setting]:
    found = (
        Setting(robot, "title", LF.TextInput, _title),
        Setting(robot, "annotations", removable=True),
        Setting(robot, "maximumSpeedScale", LF.SpeedScaleInput, _scale),
    )
    return {each.name: each for each in found}


def _validator(shape: NamedNode) -> tuple[ShaclValidator, Terms]:
    return present().derived(("validator", shape), lambda: _new_validator(shape))


def _new_validator(shape: NamedNode) -> tuple[ShaclValidator, Terms]:
    shapes = load_turtle(BLUEPRINTS)
    return ShaclValidator(chain.from_iterable(shapes.values()), shape), Terms.from_shapes(shapes, shape)


def _title(body: Body) -> str:
    text = body.text(body.root, LF.value)
    assert text is not None
    return text


def _scale(body: Body) -> str:
    value = body.node(body.root, LF.value)
    assert value is not None
    return repr(body.number(value, VOM.numericalValue))
