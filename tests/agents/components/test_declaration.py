"""What a driver's author annotates, and what the fleet is told; what cannot be declared, and why."""

import enum
from collections.abc import Callable
from typing import Annotated, Any, Literal

import msgspec
import pytest
from msgspec import Meta

from linked_fleet_agent.components import BASE, Call, Component, DeclarationError, action, event, term, unit, value
from linked_fleet_agent.components.declaration import declare
from linked_fleet_agent.components.host import declarations_of
from linked_fleet_agent.components.schemas import schema_of
from linked_fleet_agent.wire.components import (
    MAX_ACTIONS,
    MAX_COMPONENTS,
    MAX_DECLARATIONS_BYTES,
    DescriptionWithComponents,
    read_declarations,
)

Width = Annotated[float, unit("M"), Meta(ge=0, le=0.08, title="Distance of the fingers")]
LINKS, JOINTS = {"hand"}, {"finger"}


class Grasped(msgspec.Struct):
    """Left out of the declaration."""

    width: Width
    force: Annotated[float, unit("N")] | None = None


class Gripper(Component, kind="https://example.org/terms#Gripper", rate_hz=20, stale_s=1):
    """A gripper with
    two fingers.

    Left out of the declaration.
    """

    link = "hand"
    dropped = event(Grasped, title="Object dropped", description="It has lost what it held.")
    opened = event()
    lit = False

    @value
    def width(self) -> Width:
        """As measured."""
        return 0.04

    @value
    def light(self) -> bool:
        return self.lit

    @light.setter
    def set_light(self, on: bool) -> None:
        self.lit = on

    @action(moves=["finger"], duration_s=5, stop_s=0.5, rehearse=lambda self, **given: 2.0)
    def grasp(self, call: Call[float], width: Width = 0.0, force: Annotated[float, unit("N")] = 20.0) -> Grasped:
        """Close the fingers."""
        return Grasped(width, force)

    @action(title="Blink")
    async def blinkTwice(self) -> None:  # noqa: N802 - names may be of any convention
        """Show which one it is."""


DECLARED = {
    "name": "gripper",
    "title": "Gripper",
    "description": "A gripper with two fingers.",
    "@type": "https://example.org/terms#Gripper",
    "link": "hand",
    "rate_hz": 20.0,
    "stale_s": 1.0,
    "properties": {
        "width": {
            "schema": {
                "type": "number", "title": "Distance of the fingers", "description": "As measured.", "unit": "M",
                "minimum": 0, "maximum": 0.08,
            }
        },
        "light": {"schema": {"type": "boolean"}, "writable": True},
    },
    "actions": {
        "grasp": {
            "title": "Grasp",
            "description": "Close the fingers.",
            "input": {
                "type": "object",
                "properties": {
                    "width": {
                        "type": "number", "title": "Distance of the fingers", "unit": "M", "default": 0.0,
                        "minimum": 0, "maximum": 0.08,
                    },
                    "force": {"type": "number", "unit": "N", "default": 20.0},
                },
            },
            "feedback": {"type": "number"},
            "result": {
                "type": "object",
                "properties": {
                    "width": {
                        "type": "number", "title": "Distance of the fingers", "unit": "M", "minimum": 0,
                        "maximum": 0.08,
                    },
                    "force": {"type": "number", "unit": "N"},
                },
                "required": ["width"],
            },
            "moves": ["finger"],
            "duration_s": 5.0,
            "stop_s": 0.5,
            "rehearses": True,
        },
        "blinkTwice": {"title": "Blink", "description": "Show which one it is.", "duration_s": 60.0, "stop_s": 1.0},
    },
    "events": {
        "dropped": {
            "title": "Object dropped",
            "description": "It has lost what it held.",
            "data": {
                "type": "object",
                "properties": {
                    "width": {
                        "type": "number", "title": "Distance of the fingers", "unit": "M", "minimum": 0,
                        "maximum": 0.08,
                    },
                    "force": {"type": "number", "unit": "N"},
                },
                "required": ["width"],
            },
        },
        "opened": {"title": "Opened"},
    },
}  # fmt: skip


def test_a_class_becomes_its_declaration() -> None:
    said = msgspec.to_builtins(declare(Gripper()).said)
    expected = msgspec.to_builtins(msgspec.convert(DECLARED, type(declare(Gripper()).said)))
    assert said == expected


def test_gateways_accept_what_agents_declare() -> None:
    [declared] = declarations_of([Gripper()], LINKS, JOINTS)
    accepted, refused = read_declarations(msgspec.json.encode([declared.said]), LINKS, JOINTS)
    assert (accepted, refused) == ([declared.said], [])


def test_values_read_and_set_as_properties_do() -> None:
    gripper = Gripper()
    gripper.light = True
    assert gripper.light is True
    declared = declare(gripper)
    declared.setters["light"].run(value=False)
    assert declared.reads["light"]() is False
    assert declared.setters.keys() == {"light"}
    with pytest.raises(AttributeError, match="cannot be set"):
        gripper.width = 1.0


def test_what_moves_may_depend_on_the_component() -> None:
    class Wheels(Component):
        def __init__(self, *joints: str) -> None:
            self.joints = joints

        @action(moves=lambda self: (*self.joints, BASE))
        def roll(self) -> None: ...

    assert declare(Wheels("left", "right")).said.actions["roll"].moves == ("left", "right", "base")


class Colour(enum.Enum):
    RED = "red"
    GREEN = "green"


class Inner(msgspec.Struct):
    a: int
    b: str = "x"


@pytest.mark.parametrize(
    ("annotation", "expected"),
    [
        (bool, {"type": "boolean"}),
        (int, {"type": "integer"}),
        (Annotated[int, Meta(gt=0, lt=9)], {"type": "integer", "exclusiveMinimum": 0, "exclusiveMaximum": 9}),
        (Annotated[str, Meta(min_length=1, max_length=9, pattern="^a+$")],
         {"type": "string", "minLength": 1, "maxLength": 9, "pattern": "^a+$"}),
        (Annotated[float, term("https://example.org/t#x")], {"type": "number", "@type": "https://example.org/t#x"}),
        (Literal["a", "b"], {"type": "string", "enum": ["a", "b"]}),
        (Literal[1, 2], {"type": "integer", "enum": [1, 2]}),
        (Colour, {"type": "string", "enum": ["red", "green"]}),
        (Annotated[list[int], Meta(max_length=3)], {"type": "array", "items": {"type": "integer"}, "maxItems": 3}),
        (tuple[float, ...], {"type": "array", "items": {"type": "number"}}),
        (tuple[float, float], {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}),
        (Inner, {"type": "object",
                 "properties": {"a": {"type": "integer"}, "b": {"type": "string", "default": "x"}}, "required": ["a"]}),
    ],
)  # fmt: skip
def test_types_that_have_a_schema(annotation: Any, expected: dict[str, Any]) -> None:
    made = msgspec.to_builtins(schema_of(annotation))
    if "enum" in expected:
        assert sorted(made.pop("enum")) == sorted(expected.pop("enum"))
    assert msgspec.json.decode(msgspec.json.encode(made)) == expected


@pytest.mark.parametrize(
    ("annotation", "said"),
    [
        (dict[str, int], "dict has no schema"),
        (int | str, "union has no schema"),
        (bytes, "bytes has no schema"),
        (Any, "any has no schema"),
        (tuple[int, str], "the items of a tuple have different types"),
        (Literal["a", 1], "neither all texts nor all integers|has no schema"),
        (Annotated[float, Meta(multiple_of=2)], "multiple_of cannot be declared"),
        (Annotated[float, unit("no unit")], "Expected `str` matching regex"),
        (Annotated[float, term("no IRI")], "Expected `str` matching regex"),
        (complex, "custom has no schema"),
    ],
)
def test_types_without_a_schema_say_why(annotation: Any, said: str) -> None:
    with pytest.raises(DeclarationError, match=said):
        schema_of(annotation)


def _without_return(self: Any) -> None: ...


def component(**members: Any) -> Component:
    made: Component = type("Part", (Component,), members)()
    return made


def unannotated() -> Callable[..., Any]:
    def go(self, speed): ...  # type: ignore[no-untyped-def]

    return go


def with_call(hint: Any) -> Callable[..., Any]:
    def go(self: Any, call: Any) -> None: ...

    go.__annotations__["call"] = hint
    return go


def several(self: Any, *speeds: float) -> None: ...


def moving() -> Callable[..., Any]:
    def go(self: Any) -> None: ...

    return go


def mute(self): ...  # type: ignore[no-untyped-def]


def wide(self: Any) -> Annotated[str, Meta(pattern="a|b")]:
    return ""


@pytest.mark.parametrize(
    ("members", "said"),
    [
        ({"go": action()(unannotated())}, "part.go: the parameter 'speed' has no annotation"),
        ({"go": action()(with_call(int))}, "part.go: the parameter 'call' must be annotated as Call"),
        ({"go": action()(several)}, "part.go: the parameter 'speeds' must be a plain one"),
        ({"read": value(mute)}, "part.read: it has no annotation of what it returns"),
        ({"go": action(duration_s=0)(moving())}, "part: Expected `float` > 0"),
        ({"go": action(stop_s=60)(moving())}, "part: Expected `float` <= 30"),
        ({"rate_hz": 500.0}, "part: Expected `float` <= 100"),
        ({"kind": "Gripper"}, "part: Expected `str` matching regex"),
        ({"name": "x" * 129}, "Expected `str` of length <= 128"),
        ({"link": "elbow"}, "its link 'elbow' is none of the robot's"),
        ({"go": action(moves=["elbow"])(moving())}, "action 'go' moves 'elbow', which is neither a joint"),
        ({"read": value(wide)}, r"property 'read': the pattern 'a\|b' must begin"),
    ],
)
def test_components_that_cannot_be_declared_say_where_and_why(members: dict[str, Any], said: str) -> None:
    with pytest.raises(DeclarationError, match=said):
        declarations_of([component(**members)], LINKS, JOINTS)


def declared(count: int, **parts: Any) -> list[dict[str, Any]]:
    return [{"name": f"c{index}", **parts} for index in range(count)]


SWITCH = {"schema": {"type": "boolean"}}


@pytest.mark.parametrize(
    ("said", "accepted", "refused"),
    [
        ([], 0, ""),
        ({}, 0, "the components are refused: Expected `array`"),
        ([1], 0, "component 1 is refused: Expected `object`"),
        ([{"name": "a"}, {"name": "b", "wheels": 4}, {"name": "c"}], 2, "component 2 is refused: Object contains"),
        ([{"name": "a"}, {"name": "a"}], 1, "component 'a' is refused: another component has this name"),
        ([{"name": "a", "link": "tail"}], 0, "component 'a' is refused: its link 'tail' is none"),
        ([{"name": "a", "actions": {"x": {"input": {"type": "number"}}}}], 0, "it must be an object"),
        ([{"name": "a", "actions": {"x": {}}, "properties": {"x": SWITCH}}], 0, "'x' is a property and an action"),
        (declared(MAX_COMPONENTS + 1), MAX_COMPONENTS, "64 components is the maximum"),
        (declared(2, actions={f"a{index}": {} for index in range(MAX_ACTIONS)}), 1, "128 actions is the maximum"),
        (declared(64, description="x" * 4096), 0, "262144 is the maximum"),
    ],
)
def test_a_gateway_refuses_each_bad_component_by_itself(said: Any, accepted: int, refused: str) -> None:
    found, sentences = read_declarations(msgspec.json.encode(said), LINKS, JOINTS)
    assert len(found) == accepted
    assert refused in " ".join(sentences)
    assert bool(sentences) == bool(refused)


@pytest.mark.parametrize("each", [b"0", b"{}", b'{"name":"a"}'])
def test_a_declaration_of_many_components_is_refused_with_few_sentences(each: bytes) -> None:
    """The robot shows each sentence, and 256 KiB have room for a hundred thousand bad components."""
    many = (MAX_DECLARATIONS_BYTES - 2) // (len(each) + 1)
    found, sentences = read_declarations(b"[" + b",".join([each] * many) + b"]", LINKS, JOINTS)
    assert len(found) + len(sentences) == MAX_COMPONENTS + 1
    assert sentences[-1].startswith(f"the last {many - MAX_COMPONENTS} components are refused")


@pytest.mark.parametrize("payload", [b"", b"{}", b"null", b"[", b'["\xff"]', b"[" * 100_000])
def test_what_is_no_json_is_refused_with_a_sentence(payload: bytes) -> None:
    found, sentences = read_declarations(payload, LINKS, JOINTS)
    assert (found, len(sentences)) == ([], 1)


def test_a_description_without_components_declares_none() -> None:
    assert read_declarations(DescriptionWithComponents.__struct_defaults__[-1], LINKS, JOINTS) == ([], [])
