"""Invalid bodies and headers at a real gateway with a simulated robot: nothing moves, and each refusal has a reason.

A valid body is spoilt in one or more places, written in any syntax, or broken as text. Each response is a 4xx problem.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from types import MappingProxyType

import httpx
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyoxigraph import RdfFormat, parse, serialize
from rdflib import RDF

from browser import DCTERMS, HYBRIT, LF, Browser
from properties import examples
from running import Process
from small_fleet import Place, live

pytestmark = pytest.mark.virtual

_attack = settings(
    derandomize=True, max_examples=examples(100), database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)  # fmt: skip
_PREFIXES = """@prefix xsd: <http://www.w3.org/2001/XMLSchema#> . @prefix unit: <http://qudt.org/vocab/unit/> .
@prefix maths: <http://vocab.arvida.de/2015/06/maths/vocab#> . @prefix lf: <https://w3id.org/linked-fleet#> .
@prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> .
"""
_TURTLE = "text/turtle"
_SYNTAXES = {
    "application/ld+json": RdfFormat.JSON_LD,
    "application/n-triples": RdfFormat.N_TRIPLES,
    "application/rdf+xml": RdfFormat.RDF_XML,
}

# -- good bodies, and what spoils them ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Slot:
    """A term in a body: valid (absent options) and invalid values. ``must``: absence is invalid too."""

    good: str
    bad: tuple[str, ...]
    must: bool = True


_NOTHINGS = ("[]", "<nowhere>", "( 1 2 3 )", "()", '"1"@en', '"1"^^<urn:number>', "( " + "1 " * 1200 + ")")
_NUMBERS = (
    *_NOTHINGS, '"NaN"^^xsd:double', '"INF"^^xsd:float', '"-INF"^^xsd:double', "1e400", "-1e400", "9" * 4000,
    "9" * 5000, "-" + "9" * 4000, "7" * 3000 + "." + "7" * 1000, "8000000", "-8000000", "8e6", '"8000000"^^xsd:int',
    "true", "false", '"0.1"', '"one"^^xsd:double', '"0,1"^^xsd:decimal', '"0x1"^^xsd:integer', '"1_0"^^xsd:integer',
    '"١"^^xsd:integer', '""^^xsd:double', '"300"^^xsd:byte', '"-1"^^xsd:unsignedByte', '"1.5"^^xsd:int', "0.1, 0.2",
    '0.1, "0.1"^^xsd:float', "0.1, lf:unknown", "lf:unknown", "0." + "0" * 400 + "1",
)  # fmt: skip
_UNITS = (
    *_NOTHINGS, "unit:KiloGM", "unit:rad", "unit:SEC", "maths:Scalar", "<http://qudt.org/vocab/unit/RAD/>", "1", "true",
    "<https://qudt.org/vocab/unit/RAD>", '"rad"', '"http://qudt.org/vocab/unit/RAD"', "maths:Radian, unit:RAD",
    "maths:Degree, vom:Degree", "unit:M, unit:MilliM", "unit:RAD, unit:DEG",
)  # fmt: skip
_PARTS = (
    *_NOTHINGS, "<>", "</panda/panda_joint1>", "</ur5/>", "</ur5/nothing>", "</ur5/shoulder_pan_joint/>",
    "</ur5/shoulder_pan_joint/rotation>", "<http://example.org/ur5/shoulder_pan_joint>", '"shoulder_pan_joint"',
    "</ur5/world_joint>", "</ur5/base_link-base_fixed_joint>", "</ur5/../ur5/shoulder~5Fpan_joint>", "<y>, <x>",
)  # fmt: skip
_TEXTS = (*_NOTHINGS, '""', '"x"@en', "1", "true", '"a", "b"', '"' + "x" * 300 + '"', '"' + "x" * 5000 + '"', "<x>")


def _number(good: str = "0.1") -> Slot:
    return Slot(good, _NUMBERS)


def _unit(good: str) -> Slot:
    return Slot(good, _UNITS)


_JOINT, _ELBOW = Slot("</ur5/shoulder_pan_joint>", _PARTS), Slot("</ur5/elbow_joint>", _PARTS)
Body = tuple[tuple[str, "Slot | Body"], ...]
Path = tuple[int, ...]
_SCALAR: Body = (("vom:numericalValue", _number()), ("vom:unit", _unit("unit:RAD")))
_EXPECTS: Body = (("lf:ofJoint", _JOINT), *_SCALAR, ("lf:tolerance", _number("10")))
_OPTIONS: Body = (
    ("lf:precondition", _EXPECTS),
    ("lf:tiedTo", Slot("", (*_PARTS, "</panda/lease>"), must=False)),
)
_SPEED: Body = (("vom:numericalValue", _number("1")), ("vom:unit", _unit("unit:RAD-PER-SEC")))
_SCALE = ("lf:speedScale", Slot("0.5", (*_NUMBERS, "0", "1.1", "-0.5"), must=False))
_TARGETS: Body = (("lf:target", (("lf:ofJoint", _JOINT), *_SCALAR)), ("lf:target", (("lf:ofJoint", _ELBOW), *_SCALAR)))
_POINT: Body = tuple((f"maths:{axis}", _number("300")) for axis in "xyz")
_TURN: Body = (*((f"maths:{axis}", _number("0")) for axis in "xyz"), ("lf:w", _number("1")))
_GOOD: dict[str, Body] = {
    "rotate": (*_SCALAR, ("lf:speed", _SPEED), *_OPTIONS),
    "moveJoints": (*_TARGETS, _SCALE, *_OPTIONS),
    "followTrajectory": (
        ("lf:waypoint", (("lf:atTime", _number("5")), *_TARGETS)),
        ("lf:waypoint", (("lf:atTime", _number("9")), *_TARGETS)),
        _SCALE,
        *_OPTIONS,
    ),
    "reach": (
        ("lf:ofLink", Slot("</ur5/wrist_3_link>", (*_PARTS, "</ur5/shoulder_pan_joint>", "</ur5/world>"))),
        ("lf:position", (*_POINT, ("vom:unit", _unit("unit:MilliM")))),
        ("lf:orientation", _TURN),
        ("lf:frame", Slot('"base"', (*_TEXTS, '"map"', '"Base"'), must=False)),
        _SCALE,
        *_OPTIONS,
    ),
    "lease": (("lf:holder", Slot('"me"', _TEXTS)), ("lf:leaseDuration", Slot("60", (*_NUMBERS, "0", "3601")))),
    "title": (("lf:value", Slot('"UR5 älter"', _TEXTS)),),
    "maximumSpeedScale": (("lf:value", (("vom:numericalValue", Slot("1", (*_NUMBERS, "0", "1.1", "-0.5"))),)),),
    "targetRotation": (("lf:value", _SCALAR),),
}
_MOTIONS = ("rotate", "moveJoints", "followTrajectory", "reach", "targetRotation")
_targets = st.sampled_from(list(_GOOD))
_NODES = ("twice", "1", '"text"', "true", "<>", "<nowhere>", "[]", "[ vom:numericalValue 1, 2 ]", "lf:unknown")


def _places(body: Body, path: Path = ()) -> Iterator[tuple[Path, Sequence[str]]]:
    """Yield each place in a body, with its invalid values."""
    for index, (_, value) in enumerate(body):
        here = (*path, index)
        if isinstance(value, Slot):
            yield here, (*value.bad, "") if value.must else value.bad
        else:
            yield here, _NODES
            yield from _places(value, here)


def _written(body: Body, spoilt: Mapping[Path, str], path: Path = ()) -> str:
    """Return the contents of a node in Turtle, with the spoilt values in their places."""
    parts = []
    for index, (predicate, value) in enumerate(body):
        here = (*path, index)
        inner = f"[ {_written(value, spoilt, here)} ]" if isinstance(value, tuple) else value.good
        said = spoilt.get(here, inner)
        said = f"{inner}, {inner}" if said == "twice" else said
        parts += [f"{predicate} {said}"] if said else []
    return " ; ".join(parts) or "lf:reason 'nothing else'"


def _turtle(target: str, spoilt: Mapping[Path, str] = MappingProxyType({})) -> str:
    return f"{_PREFIXES}<> {_written(_GOOD[target], spoilt)} ."


@st.composite
def _spoilt_bodies(draw: st.DrawFn) -> tuple[str, str]:
    """Draw a target and a body for it with one to three faults that do not cancel each other."""
    target = draw(_targets)
    places = dict(_places(_GOOD[target]))
    paths = draw(st.lists(st.sampled_from(list(places)), min_size=1, max_size=3, unique=True))
    return target, _turtle(target, {path: draw(st.sampled_from(places[path])) for path in paths})


# -- the place ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Scene:
    """A robot that nobody moves, and the targets: URLs, with a page on which success would show."""

    browser: Browser
    gateway: Process
    robot: str
    urls: Mapping[str, str]
    shows: Mapping[str, str]

    def send(self, target: str, body: str | bytes, media_type: str = _TURTLE, **headers: str | bytes) -> httpx.Response:
        method = "POST" if target == "followTrajectory" else "PUT"
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        fields = [("content-type", media_type), *named.items()] if media_type else [*named.items()]
        return self.browser.http.request(method, self.urls[target], content=body, headers=fields)

    def shown(self, target: str) -> str:
        return self.browser.page(self.shows[target]).response.text

    def refused(self, target: str, send: Callable[[], httpx.Response]) -> httpx.Response:
        """Check that what ``send`` sends to ``target`` is refused with a reason, and changes nothing there."""
        before = self.shown(target)
        answer = send()
        told = f"{answer.status_code} {answer.text[:500]}"
        assert 400 <= answer.status_code < 500, told
        assert answer.headers["content-type"] == "application/problem+json", told
        problem = answer.json()
        assert problem["detail"].strip(), told
        assert (problem["status"], bool(problem["title"])) == (answer.status_code, True), told
        assert self.shown(target) == before, told
        return answer

    def positions(self) -> dict[str, float]:
        page = self.browser.page(str(self.browser.page(self.robot).one(LF.jointState)))
        samples = page.graph.objects(page.iri, LF.sample)
        return {
            str(page.graph.value(each, LF.ofJoint)): float(str(page.graph.value(each, LF.position))) for each in samples
        }


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Scene]:
    place = Place(tmp_path_factory.mktemp("place"))
    with ExitStack() as stack:
        gateway, browser = stack.enter_context(place.gateway())
        stack.enter_context(place.ur5())
        robot = live(browser, "ur5")
        joint = browser.part("ur5", "shoulder_pan_joint")
        actions = [
            browser.page(str(url)) for page in (robot, joint) for url in page.graph.objects(page.iri, HYBRIT.action)
        ]
        of_type = {each: page for page in actions for each in page.graph.objects(page.iri, RDF.type)}
        kinds = {each: of_type[LF[each[0].upper() + each[1:]]] for each in _MOTIONS[:-1]}
        urls = {each: page.url for each, page in kinds.items()} | {"targetRotation": str(joint.one(LF.targetRotation))}
        shows = {each: str(page.one(LF.invocations)) for each, page in kinds.items()}
        shows["targetRotation"] = shows["rotate"]
        for each in ("lease", "maximumSpeedScale"):
            urls[each] = shows[each] = str(robot.one(LF[each]))
        urls["title"] = shows["title"] = str(robot.property(LF.TextProperty))
        yield Scene(browser, gateway, robot.url, urls, shows)
        assert "Traceback" not in gateway.output, gateway.output


@pytest.fixture
def still(scene: Scene) -> Iterator[Scene]:
    """Check after the attack that the whole robot is where it was."""
    before, page = scene.positions(), scene.browser.page(scene.robot)
    title = str(page.graph.value(page.iri, DCTERMS.title))
    yield scene
    assert scene.positions() == pytest.approx(before, abs=1e-3)
    for target in _GOOD:
        assert LF.contains not in set(scene.browser.page(scene.shows[target]).graph.predicates())
    assert scene.browser.page(scene.urls["lease"]).one(LF.state) == LF.free
    page = scene.browser.page(scene.robot)
    assert str(page.graph.value(page.iri, DCTERMS.title)) == title


# -- attacks --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("target", _MOTIONS)
def test_unspoilt_bodies_are_good(still: Scene, target: str) -> None:
    """Otherwise the refusals below would prove nothing: rehearsed, the body is accepted, by the robot too."""
    answer = still.send(target, _turtle(target), prefer="dry-run")
    assert (answer.status_code, answer.headers.get("preference-applied")) == (200, "dry-run"), answer.text


@_attack
@given(attack=_spoilt_bodies(), syntax=st.sampled_from([_TURTLE, *_SYNTAXES]))
def test_spoilt_bodies(still: Scene, attack: tuple[str, str], syntax: str) -> None:
    """Missing, doubled, of another kind, out of range or of another robot, in any syntax."""
    target, turtle = attack
    body = _in_syntax(turtle, syntax, still.urls[target])
    still.refused(target, lambda: still.send(target, body, syntax))


def _in_syntax(turtle: str, media_type: str, base: str) -> bytes:
    if media_type == _TURTLE:
        return turtle.encode()
    triples = [quad.triple for quad in parse(turtle, format=RdfFormat.TURTLE, base_iri=base)]
    written = serialize(triples, format=_SYNTAXES[media_type])
    assert written is not None
    return written


_ADDED = (
    "<> lf:reason " + "[ lf:reason " * 40 + "1" + " ]" * 40 + " .",
    " ".join(f"_:n{i} lf:reason _:n{i + 1} ." for i in range(40)),
    " ".join(f"_:n{i} lf:reason _:n{(i + 1) % 40} ." for i in range(40)),
    "<> lf:reason ( " + "1 " * 5000 + ") .", "<> lf:reason " + ", ".join(map(str, range(6000))) + " .",
    "<< <> lf:reason 1 >> lf:reason 2 .", "<> lf:reason <<( <> lf:reason 1 )>> .",
    "<> lf:reason 1 {| lf:reason 2 |} .", '<> lf:reason "a"@en--ltr .', f"<> lf:reason '{'x' * 5000}' .",
    f"<{'x' * 5000}> lf:reason 1 .", "<a b> lf:reason 1 .", "<> nobody:knows 1 .", "<g> { <> lf:reason 1 }",
    "# " + "x" * 300_000, "\x00", ".",
)  # fmt: skip
_TYPES = (
    "", "text/plain", "application/json", "text/n3", "application/trig", "application/n-quads", "text/turtle/x", "x",
    "application/octet-stream", "application/x-www-form-urlencoded", "multipart/form-data; boundary=x", "*/*",
    "text/turtle; charset=utf-16", "text/turtle; charset=latin-1", "text/turtle; charset=\"", "text/turtle, text/plain",
)  # fmt: skip
_WHOLE = (
    "", " ", "# nothing", "null", "[]", "{}", "1", '"x"', "true", "[" * 5000, '{"a":' * 40 + "1" + "}" * 40, "{" * 9,
    '{"@context": "http://example.org/context", "@id": "", "lf:value": 1}', '{"@context": {"@vocab": 1}}',
    '{"@id": "", "@graph": [{"@id": "", "https://w3id.org/linked-fleet#value": "named"}]}',
    '{"@id": "", "@type": "@json", "https://w3id.org/linked-fleet#value": {"@value": "x", "@type": "@json"}}',
    '{"@id": "", "https://w3id.org/linked-fleet#value": 1e400}',
    '{"@id": "", "https://w3id.org/linked-fleet#value": NaN}',
    '{"@id": "", "https://w3id.org/linked-fleet#value": "\\ud800"}', '{"@id": "", "@included": {"@id": ""}}',
    '<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]><r>&b;</r>', "<r/>", "<rdf:RDF/>", "<" * 4000,
    "<urn:a> <urn:b> <urn:c> <urn:d> .", "<urn:a> <urn:b> .", "_:a <urn:b> _:a .", "<a> <b> <c> .", "@prefix x:",
)  # fmt: skip


_texts = st.text(st.characters(codec="utf-8"), max_size=100).map(str.encode)


@st.composite
def _broken_texts(draw: st.DrawFn) -> tuple[str, bytes, str]:
    """Draw a target, an invalid document, and its declared type."""
    target = draw(_targets)
    good = _turtle(target)
    syntax = draw(st.sampled_from([_TURTLE, *_SYNTAXES]))
    how = draw(st.sampled_from(["cut", "added", "coded", "torn", "typed", "whole", "noise", "elsewhere"]))
    if how == "cut":
        syntax = syntax.replace("n-triples", "ld+json")  # single lines of it are a document too
        body = _in_syntax(good, syntax, "http://127.0.0.1/ur5/x").rstrip()
        return target, body[: draw(st.integers(0, 10_000)) % len(body)], syntax
    if how == "added":
        return target, f"{good}\n{draw(st.sampled_from(_ADDED))}".encode(), _TURTLE
    if how == "coded":
        coding = draw(st.sampled_from(["utf-16", "utf-16-be", "utf-32", "latin-1", "cp037"]))
        return target, f"{good} # \u00e4".encode(coding), _TURTLE
    if how == "torn":
        place, body = draw(st.integers(0, len(good))), good.encode()
        tear = draw(st.sampled_from([b"\xff", b"\xed\xa0\x80", b"\xc0\x80"]))
        return target, body[:place] + tear + body[place:], _TURTLE
    if how == "typed":
        return target, good.encode(), draw(st.sampled_from(_TYPES))
    if how == "whole":
        return target, draw(st.sampled_from(_WHOLE)).encode(), draw(st.sampled_from([syntax, "application/json"]))
    if how == "noise":
        body = draw(st.one_of(st.binary(max_size=200), _texts))
        return target, body, draw(st.sampled_from([syntax, "application/json"]))
    root = draw(st.sampled_from(["<elsewhere>", "[]", "</ur5/>"]))
    return target, good.replace("<> ", f"<> lf:reason 1 . {root} ", 1).encode(), _TURTLE


@_attack
@given(attack=_broken_texts())
def test_broken_texts(still: Scene, attack: tuple[str, bytes, str]) -> None:
    """Truncated, too long, in another encoding or syntax, of an unsupported type, or noise."""
    target, body, media_type = attack
    still.refused(target, lambda: still.send(target, body, media_type))


_fields = st.binary(max_size=300).map(lambda raw: bytes(each for each in raw if each >= 0x20 and each != 0x7F).strip())


@_attack
@given(target=st.sampled_from(_MOTIONS), field=st.sampled_from(["idempotency_key", "lock_token"]), value=_fields)
def test_keys_and_tokens_that_are_none(still: Scene, target: str, field: str, value: bytes) -> None:
    """A valid body with an invalid Idempotency-Key or Lock-Token gets 400, and nothing moves."""
    answer = still.refused(target, lambda: still.send(target, _turtle(target), **{field: b"\x80 \x80" + value}))
    assert answer.status_code == 400


@_attack
@given(target=st.sampled_from(_MOTIONS), value=_fields)
def test_preferences_that_are_none(still: Scene, target: str, value: bytes) -> None:
    """They are ignored (RFC 7240, 2): no invalid body becomes valid, and the first preference still counts."""
    still.refused(target, lambda: still.send(target, _turtle(target, {(0,): "[]"}), prefer=value))
    before = still.shown(target)
    assert still.send(target, _turtle(target), prefer=b"dry-run, ~" + value).status_code == 200
    assert still.shown(target) == before
