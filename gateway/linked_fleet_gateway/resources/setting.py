"""Settings of a robot by clients: title, annotations, maximum speed scale; converted from bodies to records."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import chain

from pyoxigraph import NamedNode, Triple

from linked_fleet_gateway.base.errors import UnprocessableContent
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.rdf.shapes import BLUEPRINTS, load
from linked_fleet_gateway.rdf.unused import TYPES_OF_ALL, Terms, refuse, unused
from linked_fleet_gateway.rdf.validation import ShaclValidator, root
from linked_fleet_gateway.rdf.vocabulary import LF, RDF, VOM
from linked_fleet_gateway.resources.action_body import Body
from linked_fleet_gateway.resources.annotations import agents_part, read_annotations
from linked_fleet_gateway.resources.paths import robot_path


@dataclass(frozen=True)
class Setting:
    """One setting of one robot; ``shape`` validates its body. Annotations have neither a shape nor a form."""

    robot: Robot
    name: str
    shape: NamedNode | None = None
    read: Callable[[Body], str] | None = None
    removable: bool = False
    """True if clients may remove it by DELETE."""

    @property
    def path(self) -> str:
        return robot_path(self.robot.name) + self.name

    def admit(self, triples: Sequence[Triple], base: str, present: frozenset[Triple] = frozenset()) -> str:
        """Return the value to store in place of ``present``. Raises UnprocessableContent for an unusable body."""
        iri = base + self.path
        if self.shape is None or self.read is None:
            return read_annotations(triples, self.robot, base, iri, present)
        return self.read(validated(triples, self.shape, iri, present))

    def managed(self, described: Sequence[Triple], base: str) -> list[Triple]:
        """Return the statements of its description that clients cannot remove."""
        iri = base + self.path
        if self.shape is None:
            return agents_part(described, self.robot, base, iri)
        return managed_statements(described, self.shape, iri)


def managed_statements(described: Sequence[Triple], shape: NamedNode, iri: str) -> list[Triple]:
    """Return the statements in a description of ``iri`` that the shape of a body does not cover."""
    _, terms = _validator(shape)
    models = [each for each in described if each.predicate == RDF.type and each.object in TYPES_OF_ALL]
    return [*unused(described, NamedNode(iri), terms), *models]


def validated(triples: Sequence[Triple], shape: NamedNode, iri: str, present: frozenset[Triple] = frozenset()) -> Body:
    """Validate a body for ``iri``, which ``present`` describes as it is.

    Raises UnprocessableContent if the blueprint's shape refuses it, or does not cover a part of it that is not
    ``present``.
    """
    focus = root(triples, NamedNode(iri))
    validator, terms = _validator(shape)
    found = validator.report(triples, focus)
    constraint = f"{iri}/blueprint"
    if found is not None:
        detail, report = found
        raise UnprocessableContent(
            f"The body does not conform to the blueprint: {detail}", report=report, constraint=constraint
        )
    refuse(unused(triples, focus, terms, present), constraint)
    return Body(triples, focus)


def settings(robot: Robot) -> dict[str, Setting]:
    found = (
        Setting(robot, "title", LF.TextInput, _title),
        Setting(robot, "annotations", removable=True),
        Setting(robot, "maximumSpeedScale", LF.SpeedScaleInput, _scale),
    )
    return {each.name: each for each in found}


@cache
def _validator(shape: NamedNode) -> tuple[ShaclValidator, Terms]:
    shapes = load(BLUEPRINTS)
    return ShaclValidator(chain.from_iterable(shapes.values()), shape), Terms.of(shapes, shape)


def _title(body: Body) -> str:
    text = body.text(body.root, LF.value)
    assert text is not None
    return text


def _scale(body: Body) -> str:
    value = body.node(body.root, LF.value)
    assert value is not None
    return repr(body.number(value, VOM.numericalValue))
