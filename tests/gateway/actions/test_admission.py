"""An action is guarded by the shape that its description shows at that moment."""

from typing import Any

import pytest
from pyoxigraph import NamedNode

from linked_fleet_base.errors import UnprocessableContent
from linked_fleet_gateway.actions.admission import validate_action_body
from linked_fleet_gateway.resources.body_values import input_ntriples
from linked_fleet_rdf.serialise import parse
from linked_fleet_rdf.validation import ShaclValidator
from linked_fleet_rdf.vocabulary import HYBRIT, SH, VOM
from linked_fleet_shacl import Data, compile_shape
from shacl_findings import pyshacl_finds

_RANGE = '<limit lower="{}" upper="{}" velocity="1" effort="1"/>'
_ROTATE = "/r/elbow/actions/rotate"
_ONE = "<> vom:numericalValue 1 ; vom:unit unit:RAD ."


def _elbow(low: float = -1, high: float = 2) -> dict[str, tuple[str, str]]:
    return {"elbow": ("revolute", _RANGE.format(low, high)), "wrist": ("revolute", _RANGE.format(-1, 1))}


def _named(title: str) -> str:
    target = "lf:target [ lf:ofJoint <elbow> ; vom:numericalValue 1 ; vom:unit unit:RAD ]"
    return f'<> lf:namedPose [ dcterms:title "{title}" ; {target} ] .'


def _move(joint: str) -> str:
    return f"<> lf:target [ lf:ofJoint </r/{joint}> ; vom:numericalValue 1 ; vom:unit unit:RAD ] ."


def test_limits_of_a_new_description_guard_at_once(bench: Any) -> None:
    """An agent comes back with another URDF: what was admitted is refused, and vice versa."""
    bench.robot(_elbow())
    bench.body(_ROTATE, _ONE)
    bench.robot(_elbow(high=0.5))
    with pytest.raises(UnprocessableContent, match=r"at most 0\.5"):
        bench.body(_ROTATE, _ONE)
    bench.robot(_elbow())
    bench.body(_ROTATE, _ONE)


def test_joints_of_a_new_description_guard_at_once(bench: Any) -> None:
    """Even if the URDF is the same, and only the joints listed by the agent differ."""
    bench.robot(_elbow())
    bench.body("/r/actions/moveJoints", _move("wrist"))
    bench.robot(_elbow(), listed=["elbow"])
    with pytest.raises(UnprocessableContent, match=r"include <http://example\.org/r/elbow>"):
        bench.body("/r/actions/moveJoints", _move("wrist"))


def test_new_annotations_guard_at_once(bench: Any) -> None:
    """Poses that clients add can be assumed, those that they remove cannot; the agent's always can."""
    bench.robot(_elbow(), annotations=_named("agents"))
    bench.body("/r/actions/assumePose", '<> lf:poseName "agents" .')
    bench.fleet.configure("r", {"annotations": bench.prefixed(_named("clients"))})
    for name in ("agents", "clients"):
        bench.body("/r/actions/assumePose", f'<> lf:poseName "{name}" .')
    bench.fleet.configure("r", {})
    with pytest.raises(UnprocessableContent, match="agents"):
        bench.body("/r/actions/assumePose", '<> lf:poseName "clients" .')


def test_robots_of_one_model_have_their_own_guards(bench: Any) -> None:
    """The shape of each names its own joints, under the URL by which the client knows the fleet."""
    for name in ("r", "s"):
        bench.robot(_elbow(), name=name)
    bench.body("/r/actions/moveJoints", _move("elbow"))
    with pytest.raises(UnprocessableContent, match="joint"):
        bench.body("/s/actions/moveJoints", _move("elbow"))
    for base, known in ((bench.base, True), ("http://other.example", False)):
        turtle = bench.prefixed(_move("elbow")).encode()
        triples = parse(turtle, "text/turtle", f"{base}/r/actions/moveJoints")
        offer = bench.offer("/r/actions/moveJoints")
        assert validate_action_body(offer, triples, base).triples == triples
        if not known:
            with pytest.raises(UnprocessableContent):
                validate_action_body(offer, triples, bench.base)


def test_a_refusal_says_what_and_where(bench: Any) -> None:
    """As a sentence, as a validation report about the request, and with a link to the shape."""
    bench.robot(_elbow())
    with pytest.raises(UnprocessableContent) as caught:
        bench.body(_ROTATE, "<> vom:numericalValue 3 ; vom:unit unit:RAD .")
    error = caught.value
    assert error.detail.endswith("3 must be at most 2")
    assert error.constraint == bench.base + _ROTATE
    assert NamedNode(bench.base + _ROTATE) in {
        value for _, predicate, value in error.report if predicate == SH.focusNode
    }


def test_other_vocabularies_are_kept_with_the_input(bench: Any) -> None:
    """Foreign terms of the root and the blank nodes below are not validated (paper, 5.4), but shown."""
    bench.robot(_elbow())
    more = '; <http://example.org/why> [ <http://example.org/ticket> 17 ] ; rdfs:comment "to the left" .'
    body = bench.body(_ROTATE, _ONE.replace(" .", more))
    assert body.quantity(body.root) == 1
    assert all(word in input_ntriples(body) for word in ("_:input", "ticket", "17", "to the left", "numericalValue"))
    assert bench.body(_ROTATE, _ONE.replace("<>", "[]")).root != NamedNode(bench.base + _ROTATE)


@pytest.mark.parametrize(
    "subject",
    ["vom:numericalValue", "</r/other>", "</r/elbow>", "</other/elbow/actions/rotate>", "<rotate/x>", "<#it>", "<?q>"],
)
def test_an_input_about_another_resource_is_refused(bench: Any, subject: str) -> None:
    bench.robot(_elbow())
    with pytest.raises(UnprocessableContent, match=r"Its subject is <> .* or a blank node") as refusal:
        bench.body(_ROTATE, _ONE.replace("<>", subject))
    assert refusal.value.members["constraint"] == bench.base + _ROTATE


@pytest.mark.parametrize("subject", ["<>", "[]", "_:it", "<rotate>", f"<http://example.org{_ROTATE}>"])
def test_an_input_is_about_its_action(bench: Any, subject: str) -> None:
    bench.robot(_elbow())
    body = bench.body(_ROTATE, _ONE.replace("<>", subject))
    assert body.quantity(body.root) == 1
    assert f"_:input <{VOM.numericalValue.value}> " in input_ntriples(body)


@pytest.mark.parametrize(
    ("path", "said"),
    [
        (_ROTATE, "lf:speedScal 0.1"),
        (_ROTATE, "<http://w3id.org/linked-fleet#speedScale> 0.1"),
        (_ROTATE, "lf:speed [ vom:numericalValue 1 ; vom:unit unit:RAD-PER-SEC ; lf:scale 0.1 ]"),
        (_ROTATE, "qudt:unit unit:DEG"),
        (_ROTATE, "hybrit:speed 1"),
        (_ROTATE, "a lf:SlowRotation"),
        (_ROTATE, "<http://example.org/p> [ lf:speed 1 ]"),
        (_ROTATE, "lf:waypoint [ lf:atTime 3 ]"),
        ("/r/actions/moveJoints", "lf:speed [ vom:numericalValue 1 ; vom:unit unit:RAD-PER-SEC ]"),
        ("/r/actions/moveJoints", "vom:numericalValue 1"),
    ],
)
def test_unused_statements_in_own_vocabularies_are_refused(bench: Any, path: str, said: str) -> None:
    """A misspelt option, or one of another action: 422 names it, and nothing moves at full speed."""
    bench.robot(_elbow())
    good = _ONE if path == _ROTATE else _move("elbow")
    bench.body(path, good)
    with pytest.raises(UnprocessableContent, match="Nothing here uses") as caught:
        bench.body(path, f"{good} <> {said} ." if "<>" in good else f"{good}".replace(" .", f" ; {said} ."))
    assert caught.value.unused
    assert caught.value.constraint == bench.base + path


@pytest.mark.parametrize("said", ["<x> vom:numericalValue 100 .", "<x> <http://example.org/p> 1 ."])
def test_a_body_speaks_of_no_other_resource(bench: Any, said: str) -> None:
    """It could not be stored: an invocation only shows its input."""
    bench.robot(_elbow())
    with pytest.raises(UnprocessableContent, match="Nothing here uses"):
        bench.body(_ROTATE, f"{_ONE} {said}")


def test_the_unit_may_be_said_in_either_vocabulary(bench: Any) -> None:
    """``qudt:unit`` may repeat ``vom:unit``, as in the gateway's own descriptions."""
    bench.robot(_elbow())
    bench.body(_ROTATE, _ONE.replace(" .", " ; qudt:unit unit:RAD ; a maths:Scalar ."))


@pytest.mark.parametrize(
    "turtle", ["", "[] vom:numericalValue 1 . [] vom:unit unit:RAD .", "_:a lf:p _:b . _:b lf:p _:a ."]
)
def test_a_body_needs_one_root(bench: Any, turtle: str) -> None:
    """The request's resource, or the only subject to which nothing refers."""
    bench.robot(_elbow())
    with pytest.raises(UnprocessableContent, match="root"):
        bench.body(_ROTATE, turtle)


def test_every_guard_is_compiled_and_agrees_with_the_shape_that_is_served(bench: Any) -> None:
    """No shape of an action falls back to pySHACL, which takes a hundred times as long; both agree."""
    bench.robot(_elbow(), annotations=_named("up"))
    joint = ("rotate", "rotateBy")
    paths = [f"/r/elbow/actions/{each}" for each in joint]
    paths += [f"/r/actions/{each}" for each in ("moveJoints", "followTrajectory", "reach", "assumePose")]
    for path in paths:
        shapes = bench.described(path).triples
        (shape,) = {t.object for t in shapes if t.predicate == HYBRIT.consumes}
        focus = NamedNode(bench.base + path)
        for turtle in (_ONE, _move("elbow"), '<> lf:poseName "up" ; lf:speedScale 2 .', "<> lf:waypoint 1 ."):
            body = parse(bench.prefixed(turtle).encode(), "text/turtle", focus.value)
            found = compile_shape(shapes, shape).check(Data(body), focus)
            assert bool(found) == bool(pyshacl_finds(shapes, shape, body, focus)) == _refused(bench, path, turtle)
            assert (ShaclValidator(shapes, shape).report(body, focus) is None) == (not found)


def _refused(bench: Any, path: str, turtle: str) -> bool:
    try:
        bench.body(path, turtle)
    except UnprocessableContent:
        return True
    return False


@pytest.mark.parametrize(
    ("body", "detail"),
    [
        ("<> vom:numericalValue 1 ; vom:unit unit:RAD , unit:DEG .", "unit: must have 1 value at most, and has"),
        ("<> vom:numericalValue 1 ; vom:unit unit:M .", "unit: unit:M must be one of"),
        ("<> vom:numericalValue 99 ; vom:unit unit:RAD .", "vom:numericalValue: 99 must be at most 2"),
    ],
)
def test_a_refusal_begins_with_what_is_wrong(bench: Any, body: str, detail: str) -> None:
    """The branches of a choice are not listed if two units, or an unknown one, exclude all of them."""
    bench.robot(_elbow())
    with pytest.raises(UnprocessableContent) as caught:
        bench.body(_ROTATE, body)
    assert caught.value.detail.partition("shape of the action: ")[2].startswith(detail)


@pytest.mark.parametrize("datatype", ["integer", "decimal", "double", "unsignedByte"])
@pytest.mark.parametrize("number", [" 1 ", "1 ", "\\n1", "\\t1"])
def test_numbers_with_white_space_are_ill_typed(bench: Any, datatype: str, number: str) -> None:
    """The lexical forms of XML Schema have no white space (RDF 1.1 Concepts, 5.1): such a number moves nothing."""
    bench.robot(_elbow())
    with pytest.raises(UnprocessableContent, match="must be"):
        bench.body(_ROTATE, f'<> vom:numericalValue "{number}"^^xsd:{datatype} ; vom:unit unit:RAD .')


_JOINTS = {
    "elbow": ("revolute", '<limit lower="-2" upper="2" velocity="1" effort="1"/>'),
    "slide": ("prismatic", '<limit lower="0" upper="1" velocity="1" effort="1"/>'),
}


@pytest.mark.parametrize(
    ("joint", "said", "told"),
    [
        ("elbow", "vom:numericalValue 100 ; vom:unit unit:RAD", "100 must be at most 2"),
        ("elbow", "vom:numericalValue -100 ; vom:unit vom:Radian", "-100 must be at least -2"),
        ("elbow", "vom:numericalValue 500 ; vom:unit unit:DEG", "500 must be at most 114.591559"),
        ("slide", "vom:numericalValue 500 ; vom:unit unit:M", "500 must be at most 1"),
        ("slide", "vom:numericalValue 5000 ; vom:unit unit:MilliM", "5000 must be at most 1000"),
        ("slide", "vom:numericalValue 1 ; vom:unit unit:RAD", "unit:MilliM; or vom:unit: unit:RAD must be unit:M"),
        ("elbow", "vom:numericalValue 1 ; vom:unit unit:M", "one of maths:Radian, vom:Radian, unit:RAD"),
        ("elbow", "vom:numericalValue 1 ; vom:unit unit:M", "one of maths:Degree, vom:Degree, unit:DEG"),
        ("elbow", "vom:numericalValue 1", "unit: must have 1 value or more, and has none"),
        ("elbow", "vom:unit unit:RAD", "value: must have 1 value or more, and has none"),
    ],
)
@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("/r/actions/moveJoints", "<> lf:target [ lf:ofJoint </r/{}> ; {} ] ."),
        ("/r/actions/followTrajectory", "<> lf:waypoint [ lf:atTime 1 ; lf:target [ lf:ofJoint </r/{}> ; {} ] ] ."),
    ],
)
def test_a_refusal_is_about_the_joint_and_the_unit_of_the_body(
    bench: Any, path: str, body: str, joint: str, said: str, told: str
) -> None:
    """Each joint has a branch for each of its units, of which one is meant."""
    bench.robot(_JOINTS)
    with pytest.raises(UnprocessableContent) as refusal:
        bench.body(path, body.format(joint, said))
    assert told in refusal.value.detail
    if "100" in said or "500" in said:
        assert "must be one of" not in refusal.value.detail
