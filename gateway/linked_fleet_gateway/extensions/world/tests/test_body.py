"""Bodies of objects of the world: what is read from them, and what is refused."""

import base64
import struct

import pytest
from msgspec.structs import replace

from linked_fleet_base.errors import UnprocessableContent
from linked_fleet_gateway.extensions.world.descriptions import describe_object, read_object
from linked_fleet_gateway.extensions.world.scene import Box, Cylinder, Geometry, Held, SceneObject, Sphere, TriangleMesh
from linked_fleet_gateway.http.body import BODY_TYPES
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.serialise import parse, render
from linked_fleet_rdf.validation import ground_statements
from linked_fleet_rdf.vocabulary import PREFIXES
from linked_fleet_state.model import Pose

_BASE = "http://fleet.example"
_IRI = f"{_BASE}/world/objects/1"
_STL = b"\0" * 80 + struct.pack("<I12f2x", 1, *(0.0,) * 3, 0, 0, 0, 1, 0, 0, 0, 1, 0)
_PREFIXES = "".join(f"@prefix {prefix}: <{iri}> .\n" for prefix, iri in PREFIXES.items())
_AT = "lf:position [ maths:x 1 ; maths:y 2 ; maths:z 3 ; vom:unit unit:M ]"
_BALL = "lf:geometry [ a lf:Sphere ; lf:radius [ vom:numericalValue 1 ; vom:unit unit:M ] ]"


def _object(geometry: Geometry) -> SceneObject:
    pose = Pose((1.0, 2.0, 0.5), (0.0, 0.0, 1.0, 0.0))
    return SceneObject(title="crate", kind="zone", pose=pose, geometry=geometry)


def _read(turtle: str, present: SceneObject | None = None) -> SceneObject:
    triples = parse((_PREFIXES + turtle).encode(), "text/turtle", _IRI)
    return read_object(triples, _IRI, f"{_BASE}/world", present).settled({}, present, 1)


@pytest.mark.parametrize("media_type", BODY_TYPES)
@pytest.mark.parametrize("geometry", [Box((1.0, 2.0, 3.0)), Sphere(0.5), Cylinder(0.5, 2.0), TriangleMesh(_STL)])
def test_an_object_may_be_put_as_it_was_read(geometry: Geometry, media_type: str) -> None:
    """In each accepted syntax, with the mesh by its link: nothing changes."""
    thing, graph = _object(geometry), Graph()
    describe_object(graph, _BASE, "1", thing, {})
    triples = parse(render(graph.triples, media_type, PREFIXES, base=_IRI), media_type, _IRI)
    stated = read_object(triples, _IRI, f"{_BASE}/world", thing, ground_statements(graph))
    assert stated.settled({}, thing, 1) == thing


@pytest.mark.parametrize(
    ("said", "count"),
    [
        (f"{_AT} ; {_BALL} ; lf:orientaton [ maths:x 0 ; maths:y 0 ; maths:z 1 ; lf:w 0 ]", 5),
        (f"{_AT} ; {_BALL} ; rdfs:comment 'heavy'", 1),
        (f"{_AT} ; {_BALL} ; rdfs:seeAlso <../../world/objects>", 1),
        (f"{_AT} ; {_BALL} . <other> dcterms:title 'other'", 1),
        (f"{_AT} ; {_BALL.replace('a lf:Sphere', 'a lf:Sphere ; lf:length []')}", 1),
        (f"{_AT} ; {_BALL.replace('a lf:Sphere', 'a lf:Sphere ; lf:mesh <1/mesh>')}", 1),
        (f"{_AT.replace('vom:unit', 'qudt:unit unit:MilliM ; vom:unit')} ; {_BALL}", 1),
    ],
)
def test_unused_statements_about_an_object_are_refused(said: str, count: int) -> None:
    """Misspelt, foreign, of another geometry, or about another resource: it would be lost."""
    with pytest.raises(UnprocessableContent) as caught:
        _read(f"<> dcterms:title 'ball' ; {said} .")
    assert caught.value.constraint == f"{_IRI}/blueprint"
    assert len(caught.value.unused or ()) == count or caught.value.report is not None


def test_a_mesh_is_that_of_the_object_or_a_new_one() -> None:
    """The link shown by GET may stay beside new bytes; that of another object is refused."""
    stl = base64.b64encode(_STL).decode()
    present = _object(TriangleMesh(_STL))
    for mesh, good in (("<1/mesh>", True), ("<2/mesh>", False)):
        turtle = f'<> dcterms:title "m" ; {_AT} ; lf:geometry [ a lf:TriangleMesh ; lf:stl "{stl}" ; lf:mesh {mesh} ] .'
        if good:
            assert _read(turtle, present).geometry == present.geometry
        else:
            with pytest.raises(UnprocessableContent):
                _read(turtle, present)
        with pytest.raises(UnprocessableContent):
            _read(turtle)


def test_an_object_needs_no_description_of_itself() -> None:
    """The minimal object is an upright obstacle."""
    read = _read(f"<> dcterms:title 'ball' ; {_AT} ; {_BALL} .")
    upright = Pose((1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0))
    assert read == SceneObject(title="ball", kind="obstacle", pose=upright, geometry=Sphere(1.0))


def test_who_may_not_know_of_a_robot_does_not_learn_what_it_holds() -> None:
    held = Held("secret", "hand", Pose((0.0, 0.0, 0.1), (0.0, 0.0, 0.0, 1.0)))
    thing, graph = replace(_object(Sphere(0.5)), held=held), Graph()
    describe_object(graph, _BASE, "1", thing, {})
    said = render(graph.triples, "text/turtle", PREFIXES, base=_IRI).decode()
    assert "secret" not in said and "heldBy" not in said
    assert said.count("lf:unknown") == 7, "three coordinates, and four of the orientation"
