"""What clients set of a robot: what is remembered of a body, and what is refused."""

import contextlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyoxigraph import NamedNode

from gateway.errors import UnprocessableContent
from gateway.fleet.fleet import Appeared, Fleet
from gateway.graph.annotations import annotate
from gateway.graph.build import Graph
from gateway.graph.serialise import parse
from gateway.graph.setting import MAX_ANNOTATIONS, Setting
from gateway.graph.setting import settings as settings_of
from gateway.graph.vocab import PREFIXES

_BASE, _OTHER = "http://fleet.example:8000", "https://robots.example.org"
_PREFIXES = "".join(f"@prefix {prefix}: <{iri}> .\n" for prefix, iri in PREFIXES.items())
_PREFIXES += "@prefix ex: <http://example.org/> .\n"


def _setting(name: str) -> Setting:
    fleet = Fleet()
    fleet.apply(Appeared("r", 1), 1)
    return settings_of(fleet.robots["r"])[name]


def _admit(name: str, turtle: str) -> str:
    setting = _setting(name)
    return setting.admit(parse((_PREFIXES + turtle).encode(), "text/turtle", _BASE + setting.path), _BASE)


def _shown(annotations: str, base: str = _BASE) -> set[tuple[object, object]]:
    """What a client that knows the fleet by ``base`` reads about the robot itself."""
    graph = Graph()
    annotate(graph, NamedNode(f"{base}/r/"), annotations, f"{base}/r/")
    return {(t.predicate, t.object) for t in graph.triples if t.subject == NamedNode(f"{base}/r/")}


def _ex(term: str) -> NamedNode:
    return NamedNode(f"http://example.org/{term}")


# -- annotations ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("part", ["", "elbow", "elbow/rotation", "../s/", "../", "?x=1", "#here", "a:b", ".hidden"])
def test_annotations_keep_no_authority(part: str) -> None:
    """What was said under one URL of the fleet holds under each: IRIs below it move along."""
    remembered = _admit("annotations", f"<{_BASE}/r/> ex:near <{_BASE}/r/{part}> .".replace("/r/../", "/"))
    assert _BASE not in remembered
    for base in (_BASE, _OTHER):
        expected = f"{base}/r/{part}".replace("/r/../", "/")
        assert _shown(remembered, base) == {(_ex("near"), NamedNode(expected))}


def test_annotations_keep_other_authorities_and_words() -> None:
    """An IRI that only begins like ours, one with an empty segment, and text that looks like one."""
    texts = [f"see <{_BASE}/r/> ", f'\\"<{_BASE}/r/>', f"<{_BASE}/>\\\\"]
    iris = [f"{_BASE}0/r/", "http://fleet.example/r/", f"{_BASE}//evil.example/x", "urn:x:y"]
    objects = ", ".join([*(f'"{text}"' for text in texts), *(f"<{iri}>" for iri in iris)])
    turtle = f"<./> ex:says {objects} ."
    shown = _shown(_admit("annotations", turtle))
    triples = parse((_PREFIXES + turtle).encode(), "text/turtle", f"{_BASE}/r/annotations")
    assert shown == {(t.predicate, t.object) for t in triples}


@settings(derandomize=True, deadline=None, max_examples=100)
@given(st.text(st.characters(codec="utf-8", exclude_characters="\x00"), max_size=40))
def test_every_text_comes_back(text: str) -> None:
    """Quotes, brackets, line ends: a literal is shown as it was put."""
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
    """About the robot and at any depth below it; the answer names the term, and nothing is remembered."""
    with pytest.raises(UnprocessableContent, match="Only the gateway says <http"):
        _admit("annotations", f"<./> {said} ; ex:colour 'red' .")


def test_named_poses_are_the_robots_own_to_say() -> None:
    """lf:namedPose and what is in it."""
    pose = "[ dcterms:title 'up' ; lf:target [ lf:ofJoint <elbow> ; vom:numericalValue 1 ; vom:unit unit:RAD ] ]"
    assert "<./elbow>" in _admit("annotations", f"<./> lf:namedPose {pose} .")


def test_annotations_are_about_the_robot() -> None:
    """What is said of other resources is ignored; nothing at all takes the annotations away."""
    remembered = _admit("annotations", "<./> ex:colour 'red' ; ex:of ex:thing . ex:thing ex:p 1 . <../s/> ex:p 1 .")
    assert _shown(remembered) == _shown(remembered, _BASE)
    assert remembered.count("\n") == 2
    assert _admit("annotations", "") == ""


def test_annotations_are_bounded() -> None:
    """As long as the wire takes them."""
    many = ", ".join(f'"{index:04d}{"x" * 200}"' for index in range(900))
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


@pytest.mark.parametrize("number", ["1", "0.5", "1e-3", '"0.25"^^xsd:float', '" 1 "^^xsd:decimal'])
def test_speed_scales(number: str) -> None:
    """Above 0, at most 1, of any type that numbers have."""
    remembered = float(_admit("maximumSpeedScale", f"<> lf:value [ vom:numericalValue {number} ] ."))
    assert 0 < remembered <= 1


@pytest.mark.parametrize(("unit", "taken"), [("UNITLESS", True), ("RAD", False)])
def test_the_unit_of_a_speed_scale(unit: str, taken: bool) -> None:
    body = f"<> lf:value [ vom:numericalValue 0.5 ; vom:unit <http://qudt.org/vocab/unit/{unit}> ] ."
    with contextlib.nullcontext() if taken else pytest.raises(UnprocessableContent):
        _admit("maximumSpeedScale", body)


@pytest.mark.parametrize(
    "number", ["0", "-0.0", "1.0000001", "-1", "true", '"0.5"', '"NaN"^^xsd:double', '"INF"^^xsd:double', "1, 0.5",
               "1e-400", "0." + "0" * 400 + "1", "[]", "<x>", '"0.5"@en', '"1_0e-2"^^xsd:double', '"0x1"^^xsd:integer'],
)  # fmt: skip
def test_what_is_no_speed_scale(number: str) -> None:
    """Least of all what would come to nothing: no command could be given any more."""
    with pytest.raises(UnprocessableContent):
        _admit("maximumSpeedScale", f"<> lf:value [ vom:numericalValue {number} ] .")
    with pytest.raises(UnprocessableContent):
        _admit("maximumSpeedScale", f"<> lf:value {number} .")
