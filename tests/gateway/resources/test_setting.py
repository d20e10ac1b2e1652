"""Settings of a robot: what is stored of a body, and what is refused."""

import contextlib
import re

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyoxigraph import NamedNode

from linked_fleet_agent.wire.codec import layout
from linked_fleet_agent.wire.messages import Description
from linked_fleet_base.errors import UnprocessableContent
from linked_fleet_gateway.extensions.world.placement import placement
from linked_fleet_gateway.http.body import BODY_TYPES
from linked_fleet_gateway.resources.annotations import MAX_ANNOTATIONS, annotate
from linked_fleet_gateway.resources.body_values import Setting
from linked_fleet_gateway.resources.body_values import robot_settings as settings_of
from linked_fleet_gateway.resources.describe import Describer
from linked_fleet_gateway.resources.property import Measurement, Property
from linked_fleet_gateway.resources.settable import setting_properties
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.serialise import parse, render
from linked_fleet_rdf.turtle import write_turtle
from linked_fleet_rdf.validation import ground_statements
from linked_fleet_rdf.vocabulary import PREFIXES
from linked_fleet_state.events import Appeared, Described
from linked_fleet_state.fleet import DESCRIPTION_WAIT_NS, Fleet
from linked_fleet_state.robot import Robot
from properties import examples

_BASE, _OTHER = "http://fleet.example:8000", "https://robots.example.org"
_PREFIXES = "".join(f"@prefix {prefix}: <{iri}> .\n" for prefix, iri in PREFIXES.items())
_PREFIXES += "@prefix ex: <http://example.org/> .\n"


def _setting(name: str) -> Setting:
    fleet = Fleet()
    fleet.apply(Appeared("r", 1), 0)
    fleet.show_awaited(DESCRIPTION_WAIT_NS)
    robot = fleet.robots["r"]
    setting = _item(robot, name).put
    assert isinstance(setting, Setting)
    return setting


def _item(robot: Robot, name: str) -> Property:
    (found,) = (each for each in (*setting_properties(robot), placement(robot)) if each.segment == name)
    return found


def _admit(name: str, turtle: str) -> str:
    setting = _setting(name)
    return setting.validate(parse((_PREFIXES + turtle).encode(), "text/turtle", _BASE + setting.path), _BASE)


def _shown(annotations: str, base: str = _BASE) -> set[tuple[object, object]]:
    """Return what a client that knows the fleet by ``base`` reads about the robot itself."""
    graph = Graph()
    annotate(graph, NamedNode(f"{base}/r/"), ("", annotations), f"{base}/r/")
    return {(t.predicate, t.object) for t in graph.triples if t.subject == NamedNode(f"{base}/r/")}


def _ex(term: str) -> NamedNode:
    return NamedNode(f"http://example.org/{term}")


# -- annotations ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("part", ["", "elbow", "elbow/rotation", "../s/", "../", "?x=1", "#here", "a:b", ".hidden"])
def test_annotations_keep_no_authority(part: str) -> None:
    """Annotations stored under one URL of the fleet apply to each: IRIs below it are rewritten."""
    remembered = _admit("annotations", f"<{_BASE}/r/> ex:near <{_BASE}/r/{part}> .".replace("/r/../", "/"))
    assert _BASE not in remembered
    for base in (_BASE, _OTHER):
        expected = f"{base}/r/{part}".replace("/r/../", "/")
        assert _shown(remembered, base) == {(_ex("near"), NamedNode(expected))}


def test_annotations_keep_other_authorities_and_words() -> None:
    """An IRI with a similar beginning, one with an empty segment, and text that looks like one stay unchanged."""
    texts = [f"see <{_BASE}/r/> ", f'\\"<{_BASE}/r/>', f"<{_BASE}/>\\\\"]
    iris = [f"{_BASE}0/r/", "http://fleet.example/r/", f"{_BASE}//evil.example/x", "urn:x:y"]
    objects = ", ".join([*(f'"{text}"' for text in texts), *(f"<{iri}>" for iri in iris)])
    turtle = f"<./> ex:says {objects} ."
    shown = _shown(_admit("annotations", turtle))
    triples = parse((_PREFIXES + turtle).encode(), "text/turtle", f"{_BASE}/r/annotations")
    assert shown == {(t.predicate, t.object) for t in triples}


@settings(derandomize=True, max_examples=examples(100))
@given(st.text(st.characters(codec="utf-8", exclude_characters="\x00"), max_size=40))
def test_every_text_comes_back(text: str) -> None:
    """Quotes, brackets, line ends: a literal is returned as it was put."""
    quoted = "".join(f"\\U{ord(each):08X}" for each in text)
    ((_, value),) = _shown(_admit("annotations", f'<./> ex:says "{quoted}" .'))
    assert value.value == text  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "said",
    [
        "lf:presence lf:offline",
        "hybrit:action <http://example.org/fly>",
        "a lf:Fleet",
        "a ros:Link, ex:Toy",
        'dcterms:title "Other"',
        'dcterms:identifier "other"',
        "dcterms:hasPart ex:wing",
        "ex:maker [ lf:fault 'inner' ]",
        "ex:maker [ ex:of [ a hybrit:Action ] ]",
        "sh:property []",
        "<http://www.w3.org/ns/ldp#contains> ex:x",
    ],
)
def test_terms_of_the_gateway_are_refused(said: str) -> None:
    """About the robot and at any depth below it; the response names the term, and nothing is stored."""
    with pytest.raises(UnprocessableContent, match="Only the gateway says <http"):
        _admit("annotations", f"<./> {said} ; ex:colour 'red' .")


def test_named_poses_are_the_robots_own_to_say() -> None:
    """lf:namedPose and its contents."""
    pose = "[ dcterms:title 'up' ; lf:target [ lf:ofJoint <elbow> ; vom:numericalValue 1 ; vom:unit unit:RAD ] ]"
    assert "<./elbow>" in _admit("annotations", f"<./> lf:namedPose {pose} .")


def test_annotations_describe_what_the_robot_is_related_to() -> None:
    """Blank nodes and resources outside the fleet to which its statements lead; an empty body removes them."""
    said = "<./> ex:holds ex:tool, [ ex:p 1 ] . ex:tool ex:maker 'Ada' ; dcterms:title 'Gripper' ; ex:of <../s/> ."
    remembered = _admit("annotations", said)
    graph = Graph()
    annotate(graph, NamedNode(f"{_BASE}/r/"), ("", remembered), f"{_BASE}/r/")
    assert (len(graph.triples), len(_shown(remembered))) == (6, 2)
    assert _admit("annotations", "") == ""


@pytest.mark.parametrize(
    "more",
    [
        "ex:thing ex:p 1 .",
        "<../s/> ex:p 1 .",
        "<elbow> ex:p 1 . <./> ex:has <elbow> .",
        "[] ex:p 1 .",
        "<> ex:p 1 .",
        "<./> ex:as lf:Robot . lf:Robot ex:p 1 .",
    ],
)
def test_annotations_that_could_not_be_stored_are_refused(more: str) -> None:
    """Statements unconnected to the robot, and those about the fleet's own resources."""
    with pytest.raises(UnprocessableContent, match="nothing uses") as caught:
        _admit("annotations", f"<./> ex:colour 'red' . {more}")
    assert caught.value.constraint == f"{_BASE}/r/annotations/blueprint"
    (named,) = caught.value.unused
    assert "<http://example.org/p>" in named


_AGENTS = """<> rdfs:comment "made of steel" ; ex:maker [ ex:name "Ada" ; ex:at [ ex:name "Linz" ] ] ;
  lf:namedPose [ dcterms:title "home" ;
    lf:target [ lf:ofJoint <elbow> ; vom:numericalValue 0.5 ; vom:unit unit:RAD ] ] ."""


def _robot_with(annotations: str) -> Robot:
    fleet = Fleet()
    fleet.apply(Appeared("r", 1), 1)
    said = Description(
        version=1, robot="r", incarnation=1, title="r", urdf="<robot/>", joints=(), rate_hz=1,
        capabilities=(), annotations=_PREFIXES + annotations, layout=layout(0, False),
    )  # fmt: skip
    fleet.apply(Described(said), 1)
    return fleet.robots["r"]


def _put(robot: Robot, turtle: str) -> str:
    setting = settings_of(robot)["annotations"]
    return setting.validate(parse((_PREFIXES + turtle).encode(), "text/turtle", _BASE + setting.path), _BASE)


def _all(robot: Robot, clients: str) -> Graph:
    graph = Graph()
    annotate(graph, NamedNode(f"{_BASE}/r/"), (robot.annotations[0], clients), f"{_BASE}/r/")
    return graph


def test_annotations_of_clients_leave_those_of_the_agent() -> None:
    """PUT replaces the clients' statements: the agent's stay, whether or not they are sent back, without duplicates."""
    robot = _robot_with(_AGENTS)
    own = _all(robot, "").triples
    assert len(own) == 11
    mine = "<./> ex:colour 'red' ."
    assert len(_all(robot, _put(robot, mine)).triples) == 12
    read = write_turtle(own, PREFIXES, "")
    remembered = _put(robot, read + mine)
    assert remembered.count("\n") == 1
    assert len(_all(robot, remembered).triples) == 12
    # Data stored before there were layers contains all of it.
    assert len(_all(robot, read).triples) == 11


def test_a_changed_copy_of_what_the_agent_says_is_another_statement() -> None:
    """Blank nodes are compared by their contents."""
    robot = _robot_with(_AGENTS)
    assert len(_all(robot, _put(robot, "<./> ex:maker [ ex:name 'Ada' ; ex:at [ ex:name 'Graz' ] ] .")).triples) == 15
    assert len(_all(robot, _put(robot, "<./> ex:maker _:a . _:a ex:name 'Ada' ; ex:at _:a .")).triples) == 14


def test_a_pose_of_the_robot_is_no_other_pose() -> None:
    """422 for a pose with the title of one of the agent's poses."""
    pose = "[ dcterms:title '{}' ; lf:target [ lf:ofJoint <elbow> ; vom:numericalValue 1 ; vom:unit unit:RAD ] ]"
    robot = _robot_with(_AGENTS)
    assert "elbow" in _put(robot, f"<./> lf:namedPose {pose.format('up')} .")
    with pytest.raises(UnprocessableContent, match="names a pose 'home'"):
        _put(robot, f"<./> lf:namedPose {pose.format('home')} .")


def test_annotations_are_bounded() -> None:
    """By the limit of the Zenoh protocol."""
    many = ", ".join(f'"{index:04d}{"x" * 800}"' for index in range(200))
    with pytest.raises(UnprocessableContent, match=str(MAX_ANNOTATIONS)):
        _admit("annotations", f"<./> ex:says {many[: many.rindex(',')]} .")


# -- title and maximum speed scale ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "good"),
    [
        ('"Left arm"', True),
        ('"ä"', True),
        ('""', False),
        (f'"{"x" * 256}"', True),
        (f'"{"x" * 257}"', False),
        ('"left"@en', False),
        ("1", False),
        ("<x>", False),
        ('"a", "b"', False),
    ],
)
def test_titles(text: str, good: bool) -> None:
    """One plain text of 1 to 256 characters."""
    body = f"<> lf:value {text} ."
    if good:
        assert _admit("title", body) == text.strip('"')
    else:
        with pytest.raises(UnprocessableContent) as caught:
            _admit("title", body)
        assert caught.value.constraint == f"{_BASE}/r/title/blueprint"


_AT = "<> lf:position [ maths:x 1 ; maths:y 0 ; maths:z 0 ; vom:unit unit:M"


@pytest.mark.parametrize(
    ("name", "body", "count"),
    [
        ("title", '<> lf:value "Arm" ; dcterms:title "Arm" .', 1),
        ("title", '<> lf:value "Arm" . <../s/title> lf:value "Arm" .', 1),
        ("title", '<> lf:value "Arm" ; a ex:Text .', 1),
        ("maximumSpeedScale", "<> lf:value [ vom:numericalValue 0.5 ; lf:unit 1 ] .", 1),
        ("maximumSpeedScale", "<> lf:value [ vom:numericalValue 0.5 ] ; lf:speedScale 0.1 .", 1),
        ("placement", f"{_AT} ] ; lf:orientaton [ maths:x 0 ; maths:y 0 ; maths:z 1 ; lf:w 0 ] .", 5),
        ("placement", f"{_AT} ; qudt:unit unit:MilliM ] .", 1),
        ("placement", f"{_AT} ] ; lf:inFrame <../s/> .", 1),
    ],
)
def test_unused_statements_in_settings_are_refused(name: str, body: str, count: int) -> None:
    """Nothing is dropped silently: with a misspelt orientation the robot would face the wrong way."""
    with pytest.raises(UnprocessableContent, match="Nothing here uses") as caught:
        _admit(name, body)
    assert (len(caught.value.unused), caught.value.constraint) == (count, f"{_BASE}/r/{name}/blueprint")


@pytest.mark.parametrize("name", ["title", "annotations", "maximumSpeedScale", "placement"])
@pytest.mark.parametrize("media_type", BODY_TYPES)
def test_settings_accept_their_own_representation(name: str, media_type: str) -> None:
    """In every accepted syntax, the stored value stays the same."""
    robot = _robot_with(_AGENTS)
    clients = _put(robot, "<./> ex:colour 'red' ; ex:by [ ex:name 'Ada' ] .")
    stands = '{"position_m":[1,2,0.1],"orientation_xyzw":[0,0,0,1]}'
    robot.settings = {"title": "Arm", "annotations": clients, "maximumSpeedScale": "0.25", "placement": stands}
    graph, iri = Graph(), f"{_BASE}/r/{name}"
    item = _item(robot, name)
    assert isinstance(item.put, Setting)
    describer = Describer(_BASE)
    describer.property(robot, "/r/", item, graph, Measurement())
    triples = parse(render(graph.triples, media_type, PREFIXES, base=iri), media_type, iri)
    present = ground_statements(graph)
    found = item.put.validate(triples, _BASE, present)
    assert _without_labels(found) == _without_labels(robot.settings[name])


def _without_labels(remembered: str) -> object:
    if remembered.startswith("{"):
        return msgspec.json.decode(remembered)
    return sorted(re.sub("_:[0-9a-z]+", "_:", remembered).splitlines())


@pytest.mark.parametrize("number", ["1", "0.5", "1e-3", '"0.25"^^xsd:float'])
def test_speed_scales(number: str) -> None:
    """Above 0, at most 1, of any numeric type."""
    remembered = float(_admit("maximumSpeedScale", f"<> lf:value [ vom:numericalValue {number} ] ."))
    assert 0 < remembered <= 1


@pytest.mark.parametrize(("unit", "taken"), [("UNITLESS", True), ("RAD", False)])
def test_the_unit_of_a_speed_scale(unit: str, taken: bool) -> None:
    body = f"<> lf:value [ vom:numericalValue 0.5 ; vom:unit <http://qudt.org/vocab/unit/{unit}> ] ."
    with contextlib.nullcontext() if taken else pytest.raises(UnprocessableContent):
        _admit("maximumSpeedScale", body)


@pytest.mark.parametrize(
    "number", ["0", "-0.0", "1.0000001", "-1", "true", '"0.5"', '"NaN"^^xsd:double', '"INF"^^xsd:double', "1, 0.5",
               "1e-400", "0." + "0" * 400 + "1", "[]", "<x>", '"0.5"@en', '"1_0e-2"^^xsd:double', '" 1 "^^xsd:decimal',
               '"0x1"^^xsd:integer'],
)  # fmt: skip
def test_invalid_speed_scales_are_refused(number: str) -> None:
    """Above all numbers that are rounded to zero, with which no command would be possible any more."""
    with pytest.raises(UnprocessableContent):
        _admit("maximumSpeedScale", f"<> lf:value [ vom:numericalValue {number} ] .")
    with pytest.raises(UnprocessableContent):
        _admit("maximumSpeedScale", f"<> lf:value {number} .")
