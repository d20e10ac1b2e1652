"""Known kinds: what conforms to each, what does not and why, and who refuses it."""

import re
from pathlib import Path
from typing import Any

import msgspec
import pytest

from linked_fleet_agent.wire.components import Component, Property, declaration_problem, read_declarations
from linked_fleet_agent.wire.kinds import KINDS, LF, kind_problem, with_terms

NAMES = sorted(iri.removeprefix(LF) for iri in KINDS)
ABSENT: Any = object()
GRASP, DRIVE = ("actions", "grasp"), ("actions", "drive")


def declared(kind: str) -> dict[str, Any]:
    """Return the least declaration of a kind, as on the wire."""
    found: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(KINDS[LF + kind].least))
    return found


def changed(kind: str, path: tuple[str | int, ...], to: object) -> Component:
    said = declared(kind)
    *inner, last = path
    place: Any = said
    for key in inner:
        place = place[key]
    if to is ABSENT:
        del place[last]
    else:
        place[last] = to
    return msgspec.convert(said, Component)


def test_there_are_seven_kinds() -> None:
    assert NAMES == ["Base", "Battery", "Diagnostics", "Gripper", "Jogging", "Mode", "Switch"]


@pytest.mark.parametrize("kind", NAMES)
def test_the_least_component_of_a_kind_conforms_and_can_be_declared(kind: str) -> None:
    assert declaration_problem(KINDS[LF + kind].least, (), ()) == ""


def test_a_base_may_lack_what_only_some_can_do() -> None:
    properties = ("driveLimits", "path", "stations", "dockedAt")
    optional = {"actions": ("followPath", "dock", "undock"), "properties": properties}
    for kind, names in optional.items():
        for name in names:
            assert kind_problem(changed("Base", (kind, name), ABSENT)) == ""
    approach = (*schema("stations"), "items", "properties", "approach")
    assert kind_problem(changed("Base", approach, ABSENT)) == "", "its way into a station may be one of its own"
    assert "'station'; this one's has none" in kind_problem(changed("Base", ("actions", "dock", "input"), ABSENT))
    other = changed("Base", ("actions", "followPath", "moves"), ["wheel"])
    assert "an action 'followPath' that moves base" in kind_problem(other)


def schema(name: str) -> tuple[str, str, str]:
    return ("properties", name, "schema")


INPUT, RESULT = (*GRASP, "input"), (*GRASP, "result")
ITEMS = (*schema("status"), "items")
NUMBER = {"type": "number"}


@pytest.mark.parametrize(
    ("kind", "path", "to", "said"),
    [
        ("Base", (*DRIVE, "moves"), ABSENT, "a Base has an action 'drive' that moves base; this one's does not"),
        ("Base", (*DRIVE, "moves"), ["wheel"], "a Base has an action 'drive' that moves base; this one's does not"),
        (
            "Base",
            (*DRIVE, "input", "properties", "duration", "maximum"),
            2,
            "'duration' of at most 1; this one's has the maximum 2",
        ),
        ("Gripper", ("properties", "width"), ABSENT, "a Gripper has a property 'width'; this one has none"),
        ("Gripper", (*schema("width"), "unit"), "MilliM", "'width' in M; this one's is in MilliM"),
        ("Gripper", (*schema("width"), "unit"), ABSENT, "'width' in M; this one's is without unit"),
        ("Gripper", (*schema("width"), "minimum"), -1, "'width' of at least 0; this one's has the minimum -1"),
        ("Gripper", (*schema("width"), "minimum"), ABSENT, "'width' of at least 0; this one's has no minimum"),
        ("Gripper", (*schema("width"), "@type"), ABSENT, f"'width' of the @type {LF}width; this one's is of none"),
        ("Gripper", (*schema("width"), "@type"), LF + "mass", f"{LF}width; this one's is of {LF}mass"),
        ("Gripper", (*schema("holding"), "type"), "string", "'holding' of the type boolean; this one's is of the type"),
        ("Gripper", GRASP, ABSENT, "a Gripper has an action 'grasp'; this one has none"),
        ("Gripper", (*GRASP, "@type"), ABSENT, f"'grasp' of the @type {LF}Grasp; this one's is of none"),
        ("Gripper", INPUT, ABSENT, "an action 'grasp' with an input 'width'; this one's has none"),
        ("Gripper", (*INPUT, "properties", "force"), ABSENT, "'grasp' with an input 'force'; this one's has none"),
        ("Gripper", (*INPUT, "properties", "force", "unit"), "KiloN", "input 'force' in N; this one's is in KiloN"),
        ("Gripper", (*INPUT, "required"), ["force"], "an input that may lack 'force'; this one requires it"),
        ("Gripper", RESULT, ABSENT, "'grasp' with a result; this one's has none"),
        ("Gripper", (*RESULT, "required"), ["width"], "a result that always has 'holding'; this one's may lack it"),
        ("Gripper", (*RESULT, "properties", "width", "unit"), "IN", "result with 'width' in M; this one's is in IN"),
        ("Gripper", ("events", "lost"), ABSENT, "a Gripper has an event 'lost'; this one has none"),
        ("Gripper", ("events", "lost", "@type"), ABSENT, f"an event 'lost' of the @type {LF}ObjectLost"),
        ("Battery", (*schema("charge"), "maximum"), 1000, "'charge' of at most 100; this one's has the maximum 1000"),
        ("Battery", (*schema("voltage"), "unit"), "MilliV", "'voltage' in V; this one's is in MilliV"),
        ("Battery", (*schema("powerSupplyState"), "enum"), ["full", "idle"], "this one's is one of full, idle"),
        ("Battery", (*schema("powerSupplyState"), "enum"), ABSENT, "full, unknown; this one's is one of any text"),
        ("Switch", ("properties",), {}, "a Switch has a property 'output' or 'input'; this one has none"),
        ("Switch", ("properties", "output", "writable"), ABSENT, "'output' that can be set; this one's cannot"),
        ("Mode", ("properties", "mode", "writable"), False, "a Mode has a property 'mode' that can be set"),
        ("Mode", ("actions", "reset", "moves"), ["base"], "'reset' that moves nothing; this one's moves base"),
        ("Mode", ("actions", "reset", "input"), {"type": "object", "properties": {"x": NUMBER}, "required": ["x"]},
         "'reset' with an input that may lack 'x'; this one requires it"),
        ("Diagnostics", (*ITEMS, "required"), [], "'status' with items that always has 'name'; this one's may lack it"),
        ("Diagnostics", (*ITEMS, "properties", "level"), {"type": "integer"}, "with 'level' of the type string"),
    ],
)  # fmt: skip
def test_what_does_not_conform_is_refused_with_what_the_kind_has(
    kind: str, path: tuple[str | int, ...], to: object, said: str
) -> None:
    assert said in kind_problem(changed(kind, path, to))
    assert kind_problem(msgspec.structs.replace(changed(kind, path, to), semantic_type="")) == ""


@pytest.mark.parametrize(
    ("kind", "path", "to"),
    [
        ("Gripper", ("properties", "more"), {"schema": NUMBER}),
        ("Gripper", (*schema("width"), "maximum"), 0.08),
        ("Gripper", (*INPUT, "properties", "speed"), NUMBER),
        ("Gripper", (*RESULT, "properties", "speed"), NUMBER),
        ("Gripper", (*GRASP, "moves"), ["finger"]),
        ("Battery", ("properties", "voltage"), ABSENT),
        ("Battery", (*schema("charge"), "type"), "integer"),
        ("Battery", (*schema("powerSupplyState"), "enum"), ["charging", "discharging"]),
        ("Switch", ("properties", "input"), ABSENT),
        ("Switch", ("properties", "output"), ABSENT),
        ("Mode", ("properties", "speedScale", "writable"), True),
        ("Diagnostics", (*ITEMS, "properties", "since"), NUMBER),
    ],
)
def test_a_component_may_have_more_than_its_kind_and_be_narrower(
    kind: str, path: tuple[str | int, ...], to: object
) -> None:
    assert kind_problem(changed(kind, path, to)) == ""


def test_a_gateway_refuses_such_a_component_alone() -> None:
    bad = msgspec.json.encode(changed("Gripper", (*schema("width"), "unit"), "MilliM"))
    good = msgspec.json.encode(KINDS[LF + "Battery"].least)
    accepted, refused = read_declarations(b"[" + bad + b"," + good + b"]", (), ())
    assert [each.name for each in accepted] == ["battery"]
    [said] = refused
    assert said == "component 'gripper' is refused: a Gripper has a property 'width' in M; this one's is in MilliM"


@pytest.mark.parametrize("kind", NAMES)
def test_terms_of_a_kind_are_filled_in_and_those_of_others_stay(kind: str) -> None:
    least = KINDS[LF + kind].least
    plain = msgspec.json.encode(least)
    for iri in _terms(msgspec.to_builtins(least)) - {LF + kind}:
        plain = plain.replace(b'"@type":"' + iri.encode() + b'"', b'"@type":""')
    bare = msgspec.json.decode(plain, type=Component)
    assert kind_problem(bare) != ""
    assert with_terms(bare) == least
    other = msgspec.structs.replace(bare, semantic_type="https://example.org/Thing")
    assert with_terms(other) == other


def _terms(value: Any) -> set[str]:
    if isinstance(value, dict):
        here = {value["@type"]} if value.get("@type") else set()
        return here.union(*map(_terms, value.values()))
    return set().union(*map(_terms, value)) if isinstance(value, list | tuple) else set()


def test_a_term_of_ones_own_is_not_replaced() -> None:
    own = changed("Gripper", (*schema("width"), "@type"), "https://example.org/gap")
    assert with_terms(own) == own


def test_the_vocabulary_describes_each_kind_and_its_terms() -> None:
    text = (Path(__file__).parents[3] / "shapes/linked_fleet_shapes/vocabulary.ttl").read_text()
    described = set(re.findall(r"^lf:(\w+) a rdfs?:\w+ ; rdfs:label .* rdfs:comment ", text, re.M))
    terms = {iri for each in KINDS.values() for iri in _terms(msgspec.to_builtins(each.least))}
    assert {iri.removeprefix(LF) for iri in terms if iri.startswith(LF)} <= described
    assert len(terms) > 20


def test_the_blueprint_of_each_kind_requires_the_properties_that_its_components_cannot_lack() -> None:
    text = (Path(__file__).parents[3] / "shapes/linked_fleet_shapes/blueprints.ttl").read_text()
    for kind in KINDS.values():
        [shape] = re.findall(rf"^lf:{kind.name}Shape a sh:NodeShape ;.*?^$", text + "\n", re.M | re.S)
        assert f"sh:targetClass lf:{kind.name} ;" in shape
        for name, each in kind.least.properties.items():
            required = re.findall(
                rf"sh:property \[ sh:path lf:{_local(each)}( ; sh:minCount 1)? ; sh:maxCount 1", shape
            )
            assert required == ["" if name in kind.optional else " ; sh:minCount 1"]
        if needed := kind.least.actions.keys() - kind.optional:
            assert f"sh:path hybrit:action ; sh:minCount {len(needed)} ;" in shape


def _local(declared: Property) -> str:
    return declared.schema.semantic_type.removeprefix(LF)


def test_a_refusal_is_a_sentence_however_long_what_it_names_is() -> None:
    said = {"name": "c", "properties": {"p": {"schema": {"type": "object", "required": ["r" * 10_000]}}}}
    accepted, refused = read_declarations(msgspec.json.encode([said]), (), ())
    assert (accepted, [len(each) for each in refused]) == ([], [1024])
