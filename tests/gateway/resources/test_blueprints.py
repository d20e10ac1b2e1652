"""Blueprints by mutation: each resource conforms to its own, and nothing else does, not even the resource with less."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import pyshacl
import pytest
import rdflib
from pyoxigraph import NamedNode, Triple

from all_terms import LF
from graphs import graph_of
from linked_fleet_rdf.vocabulary import DCTERMS, HYBRIT, LDP, PROV, RDF, ROS, SH, SOSA, XHV, Namespace
from linked_fleet_shacl import CompiledShape, Data, compile_shape
from sample_resources import BASE, blueprint_path, described, described_paths, tree

_SH = rdflib.Namespace(str(rdflib.SH))
# A resource may lack these: they depend on its parts, actions and options, and on past events.
_OPTIONAL = {
    LF.placement, HYBRIT.action, LDP.contains, DCTERMS.hasPart, LF.fault, LF.reason, LF.currentTask, LF.lastSeen,
    LF.parentJoint, LF.childJoint, XHV.prev, XHV.next, LF.mimic, LF.targetRotation, LF.targetTranslation,
    LF.modelName, LF.things, LF.rules, LF.world, LF.cameras, LF.history, LF.histories, SOSA.hosts, LF.mesh,
    PROV.wasAssociatedWith, PROV.startedAtTime, PROV.endedAtTime, SOSA.actsOnProperty, LF.duration, LF.target,
    LF.result, LF.answer, LF.preempts, LF.body, LF.binding, LF.sample, LF.field, LF.collision,
    LF.availability, LF.tags,
}  # fmt: skip
# At least one of several, or a number counted by the shape.
_SEVERAL = {HYBRIT.property, DCTERMS.format, Namespace("http://www.w3.org/ns/hydra/core#", "view").view}


@dataclass(frozen=True)
class Case:
    """A resource, its description, and its blueprint."""

    path: str
    data: tuple[Triple, ...]
    shapes: tuple[Triple, ...]

    @property
    def iri(self) -> NamedNode:
        return NamedNode(BASE + self.path)

    @property
    def target(self) -> NamedNode:
        """The only shape that names the resource."""
        (shape,) = [t.subject for t in self.shapes if t.predicate == SH.targetNode and t.object == self.iri]
        return shape

    def about(self) -> list[Triple]:
        return [t for t in self.data if t.subject == self.iri]


@cache
def _cases() -> dict[str, Case]:
    here = tree()
    found = {}
    for path in described_paths(here):
        data = described(here, path)
        blueprint = blueprint_path(data, path)
        if blueprint is not None:
            found[path] = Case(path, tuple(data), tuple(described(here, blueprint)))
    return found


@cache
def _one_of_each_kind() -> dict[str, Case]:
    """Return the smallest description of each set of types."""
    found: dict[frozenset[object], Case] = {}
    for case in sorted(_cases().values(), key=lambda each: len(each.data)):
        types = frozenset(t.object for t in case.about() if t.predicate == RDF.type)
        # Robots with and without a description differ in more than their types.
        found.setdefault(types | {t.predicate for t in case.about() if t.predicate == LF.rootLink}, case)
    return {case.path: case for case in found.values()}


def _conforms(data: list[Triple] | tuple[Triple, ...], shapes: tuple[Triple, ...]) -> bool:
    return bool(pyshacl.validate(graph_of(data), shacl_graph=graph_of(shapes), inference="none")[0])


def _guard(case: Case) -> CompiledShape:
    return compile_shape(case.shapes, case.target)


def test_there_are_all_kinds() -> None:
    types = {t.object for case in _cases().values() for t in case.about() if t.predicate == RDF.type}
    expected = {
        LF.Fleet, LF.Robot, ROS.RevoluteJoint, LF.ContinuousJoint, LF.PrismaticJoint, LF.FixedJoint, LF.FloatingJoint,
        LF.PlanarJoint, ROS.Link, LF.ScalarProperty, LF.Translation, LF.Limits, LF.Pose, LF.Twist, LF.Point, LF.Inertia,
        LF.Mimicry, LF.JointState, LF.FrameLayout, LF.ControlLease, LF.TextProperty, LF.SpeedScale, LF.Annotations,
        LF.TargetPosition, LF.Model, LF.Camera, LF.Cameras, LF.History, LF.Invocation, LF.Stream, HYBRIT.WebCallback,
        LF.Rule, LF.Firing, LF.World, LF.Placement, LF.SceneObjects, LF.Obstacle, LF.KeepOutZone,
    }  # fmt: skip
    assert expected <= types
    assert len(_cases()) > 200


def test_every_resource_conforms_to_its_blueprint() -> None:
    """Validate with the gateway's own engine."""
    for case in _cases().values():
        assert not _guard(case).check(Data(case.data), case.iri), case.path


def test_every_triple_of_a_resource_is_required_unless_it_may_be_absent() -> None:
    for case in _cases().values():
        guard, data = _guard(case), case.data
        about = [t for t in data if t.subject == case.iri]
        for triple in about:
            if triple.predicate in _OPTIONAL or _is_subtype(triple, about) or _is_fault(triple, about):
                continue
            taken = (
                {triple} if triple.predicate not in _SEVERAL else {t for t in about if t.predicate == triple.predicate}
            )
            less = [t for t in data if t not in taken]
            assert guard.check(Data(less), case.iri), f"{case.path} conforms without {triple}"


def _is_fault(triple: Triple, about: list[Triple]) -> bool:
    """Return True for the presence of the robot in a property, which is stated only for a faulty robot."""
    return triple.predicate == LF.presence and Triple(triple.subject, RDF.type, LF.Robot) not in about


def _is_subtype(triple: Triple, about: list[Triple]) -> bool:
    """Return True if the type states the protocol of a stream, which the blueprint does not."""
    return triple.predicate == RDF.type and triple.object in (LF.WebSocketStream, LF.EventStream)


_KINDS = sorted(_one_of_each_kind())


@pytest.mark.parametrize("path", _KINDS)
def test_pyshacl_agrees(path: str) -> None:
    """The resource conforms; an empty graph and the description of another resource of the same kind do not."""
    case = _one_of_each_kind()[path]
    assert _conforms(case.data, case.shapes)
    assert not _conforms((), case.shapes)
    other = NamedNode(BASE + "/another")
    foreign = [Triple(*(other if term == case.iri else term for term in t)) for t in case.data]  # type: ignore[arg-type]
    assert not _conforms(foreign, case.shapes)


@pytest.mark.parametrize("path", _KINDS)
def test_pyshacl_misses_what_the_blueprint_requires(path: str) -> None:
    """Each sh:class, sh:hasValue and sh:minCount of the shape, and of the shapes of the same node."""
    case = _one_of_each_kind()[path]
    shapes = graph_of(case.shapes)
    required = list(_required(shapes, rdflib.URIRef(case.target.value)))
    assert len(required) >= 4
    for predicate, value in required:
        less = graph_of(case.data)
        less.remove((rdflib.URIRef(case.iri.value), predicate, value))
        assert len(less) < len(set(case.data)), f"{path} has no {predicate} {value}"
        conforms, *_ = pyshacl.validate(less, shacl_graph=shapes, inference="none")
        assert not conforms, f"{path} conforms without {predicate} {value or ''}"


def _required(
    shapes: rdflib.Graph, shape: rdflib.term.Node
) -> Iterator[tuple[rdflib.term.Node, rdflib.term.Node | None]]:
    for wanted in shapes.objects(shape, _SH["class"]):
        yield rdflib.RDF.type, wanted
    for each in shapes.objects(shape, _SH.property):
        path, count, value = (shapes.value(each, p) for p in (_SH.path, _SH.minCount, _SH.hasValue))
        if value is not None or (count is not None and int(str(count)) > 0):
            yield path, value
    for inner in shapes.objects(shape, _SH.node):
        yield from _required(shapes, inner)
