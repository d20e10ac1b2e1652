"""Trees of BehaviorTree.CPP 4 become missions and back; what a mission cannot say is refused with its line."""

import string
from typing import Any
from xml.sax.saxutils import quoteattr

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_gateway.api import BadRequest, UnprocessableContent
from linked_fleet_gateway.extensions.missions.mission import (
    Confirm,
    FirstOf,
    Invoke,
    Mission,
    Notify,
    Parallel,
    Parameter,
    Repeat,
    Sequence,
    Step,
    Variable,
    Wait,
    walk,
)
from linked_fleet_gateway.extensions.missions.reading import check
from linked_fleet_gateway.extensions.missions.tree_reading import read_tree
from linked_fleet_gateway.extensions.missions.tree_writing import write_tree

BASE = "http://fleet.example"
MODEL = """
  <TreeNodesModel>
    <SubTree ID="Main">
      <input_port name="angle" type="double" default="0.1"/><input_port name="who" type="std::string"/>
    </SubTree>
    <Action ID="rotate"><input_port name="value" type="double"/></Action>
  </TreeNodesModel>"""


def document(inside: str, more: str = MODEL, main: str = ' main_tree_to_execute="Main"') -> bytes:
    tree = f'<BehaviorTree ID="Main">{inside}</BehaviorTree>'
    return f'<root BTCPP_format="4"{main}>\n{tree}{more}\n</root>'.encode()


def step(inside: str, more: str = MODEL) -> dict[str, Any]:
    """Return the first step of a tree in JSON."""
    found: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(read_tree(document(inside, more), BASE).step))
    return found


ROTATE = '<Action ID="rotate" action="/ur5/elbow/actions/rotate" value="{angle}" unit="deg"/>'
TURN = {
    "type": "invoke",
    "action": BASE + "/ur5/elbow/actions/rotate",
    "body": {"value": {"variable": "angle"}, "unit": "deg"},
}


@pytest.mark.parametrize(
    ("inside", "wanted"),
    [
        (ROTATE, TURN),
        (ROTATE.replace('Action ID="rotate"', "rotate"), TURN),
        (f"<Sequence>{ROTATE}</Sequence>", {"type": "sequence", "steps": [TURN]}),
        (f"<Fallback>{ROTATE}</Fallback>", {"type": "firstOf", "steps": [TURN]}),
        (f"<Parallel>{ROTATE * 2}</Parallel>", {"type": "parallel", "steps": [TURN, TURN]}),
        (
            f'<Parallel success_count="2" failure_count="1">{ROTATE * 2}</Parallel>',
            {"type": "parallel", "steps": [TURN, TURN]},
        ),
        (
            f'<Parallel success_count="1" failure_count="2">{ROTATE * 2}</Parallel>',
            {"type": "parallel", "steps": [TURN, TURN], "anySuffices": True},
        ),
        (f'<Repeat num_cycles="3">{ROTATE}</Repeat>', {"type": "repeat", "times": 3, "step": TURN}),
        ('<Sleep msec="1500"/>', {"type": "wait", "seconds": 1.5}),
        (
            f'<Delay delay_msec="200">{ROTATE}</Delay>',
            {"type": "sequence", "steps": [{"type": "wait", "seconds": 0.2}, TURN]},
        ),
        ('<Sleep name="rest" msec="1"/>', {"type": "wait", "seconds": 0.001, "name": "rest"}),
        ('<Sleep name="have a rest" msec="1"/>', {"type": "wait", "seconds": 0.001, "title": "have a rest"}),
        ('<Action ID="Confirm" text="go?"/>', {"type": "confirm", "text": "go?"}),
        ('<Action ID="Wait" condition="SELECT ?a {}"/>', {"type": "wait", "condition": "SELECT ?a {}"}),
        (
            '<Action ID="x" kind="urn:k" of="{who}" a="json:[1]" b="true" c="json:&quot;5&quot;" d="-2" angle="{=}"/>',
            {
                "type": "invoke", "kind": "urn:k", "of": {"variable": "who"},
                "body": {"a": [1], "b": True, "c": "5", "d": -2, "angle": {"variable": "angle"}},
            },
        ),
    ],
)  # fmt: skip
def test_elements_become_steps(inside: str, wanted: dict[str, Any]) -> None:
    assert step(inside) == wanted


def test_input_ports_of_the_main_tree_are_parameters() -> None:
    mission = read_tree(document(ROTATE), BASE)
    assert mission.title == "Main"
    assert mission.parameters == (Parameter("angle", "number", default=0.1), Parameter("who", "text"))


def sub(inside: str, call: str) -> dict[str, Any]:
    return step(call, f'<BehaviorTree ID="Sub">{inside}</BehaviorTree>{MODEL}')


def test_subtrees_take_the_place_of_their_calls() -> None:
    inside = ROTATE.replace("{angle}", "{how_far}")
    assert sub(inside, '<SubTree ID="Sub" how_far="{angle}"/>') == TURN
    assert sub(inside, '<SubTree ID="Sub" how_far="0.5"/>')["body"]["value"] == 0.5
    assert sub(ROTATE, '<SubTree ID="Sub" _autoremap="true"/>') == TURN
    nested = '<Action ID="x" action="/a" body="json:{&quot;a&quot;: [{&quot;variable&quot;: &quot;port&quot;}]}"/>'
    assert sub(nested, '<SubTree ID="Sub" port="{who}"/>')["body"] == {"a": [{"variable": "who"}]}
    call = '<SubTree ID="Sub" angle="1"/>'
    twice = sub(ROTATE.replace("/>", ' name="turn"/>'), f"<Sequence>{call * 2}</Sequence>")
    assert [(each.get("name"), each.get("title")) for each in twice["steps"]] == [("turn", None), (None, "turn")]


@pytest.mark.parametrize(
    ("inside", "says"),
    [
        (f"<Sequence>\n<ReactiveSequence>{ROTATE}</ReactiveSequence></Sequence>", "<ReactiveSequence> in line 3"),
        (f'<RetryUntilSuccessful num_attempts="3">{ROTATE}</RetryUntilSuccessful>', "a Fallback with the attempts"),
        ('<Script code="x:=1"/>', "give its parameters defaults"),
        (f"<Inverter>{ROTATE}</Inverter>", "<Inverter> in line 2 is no element"),
        ("<OpenDoor/>", "has the port action"),
        ('<Condition ID="IsOpen"/>', "SPARQL"),
        ('<Action ID="OpenDoor"/>', '<Action ID="OpenDoor"> in line 2'),
        ("<Sequence/>", "at least one"),
        (f'<Sequence _skipIf="a">{ROTATE}</Sequence>', "the attribute _skipIf"),
        (ROTATE.replace("/>", ' _onSuccess="x:=1"/>'), "the attribute _onSuccess"),
        (ROTATE.replace("{angle}", "{angel}"), "{angel} has no value"),
        (ROTATE.replace("{angle}", "{@angle}"), "neither the name of a parameter"),
        (ROTATE.replace("{angle}", "json:{"), "no JSON after json:"),
        (ROTATE.replace("{angle}", "1e999"), "1e999 is not finite"),
        (ROTATE.replace("{angle}", "json:[NaN]"), "NaN is not finite"),
        (ROTATE.replace("{angle}", "json:&quot;\\ud800&quot;"), "surrogates not allowed"),
        (ROTATE.replace("/>", ' body="json:{}"/>'), "the port body"),
        (ROTATE.replace("/>", f">{ROTATE}</Action>"), "is a leaf"),
        (ROTATE.replace("/ur5/elbow/actions/rotate", "{who}"), "action takes no parameter"),
        (f'<Parallel success_count="2" failure_count="2">{ROTATE * 3}</Parallel>', "thresholds"),
        (f'<Repeat num_cycles="-1">{ROTATE}</Repeat>', "times"),
        (f'<Repeat num_cycles="{{angle}}">{ROTATE}</Repeat>', "num_cycles takes no parameter"),
        (f'<Repeat num_cycles="often">{ROTATE}</Repeat>', "whole number, not 'often'"),
        (f'<Repeat num_cycles="2">{ROTATE * 2}</Repeat>', "it takes one"),
        ('<Sleep msec="1" for="ever"/>', "the attribute for"),
        ('<SubTree ID="None"/>', "no BehaviorTree with its ID 'None'"),
        ('<SubTree ID="Main"/>', "no circles"),
        ("<Sequence>" * 20 + ROTATE + "</Sequence>" * 20, "one step too many"),
        (f"<Sequence>{ROTATE * 201}</Sequence>", "one step too many"),
    ],
)
def test_what_a_mission_cannot_say_is_refused_by_name(inside: str, says: str) -> None:
    with pytest.raises(UnprocessableContent) as refused:
        step(inside)
    assert says in refused.value.detail, refused.value.detail


@pytest.mark.parametrize(
    ("content", "error", "says"),
    [
        (b"<root", BadRequest, "line 1"),
        (b'<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "c">]><root>&b;</root>', BadRequest, "document type"),
        (b"\xff\xfe", BadRequest, "UTF-8"),
        (b"<root>" + b"<a>" * 100, BadRequest, "deeper than 64"),
        (b"<root>" + b"<a/>" * 2001 + b"</root>", BadRequest, "more than 2000 elements"),
        (b"<root/>", UnprocessableContent, 'BTCPP_format="4"'),
        (b'<root BTCPP_format="3"/>', UnprocessableContent, 'BTCPP_format="4"'),
        (b'<root BTCPP_format="4"/>', UnprocessableContent, "main_tree_to_execute"),
        (document(ROTATE, '<include path="x"/>'), UnprocessableContent, "<include> in line 2"),
        (document(ROTATE, f'<BehaviorTree ID="B">{ROTATE}</BehaviorTree>', ""), UnprocessableContent, "are several"),
        (document(ROTATE, f'<BehaviorTree ID="Main">{ROTATE}</BehaviorTree>'), UnprocessableContent, "of another one"),
        (document(ROTATE, MODEL.replace("double", "Pose")), UnprocessableContent, "has a type"),
        (document(ROTATE, MODEL.replace("input_port", "output_port")), UnprocessableContent, "no input_port"),
    ],
)  # fmt: skip
def test_documents_that_are_no_trees_are_refused(content: bytes, error: type[Exception], says: str) -> None:
    with pytest.raises(error) as refused:
        read_tree(content, BASE)
    assert says in refused.value.detail  # type: ignore[attr-defined]


def test_trees_that_call_each_other_do_not_grow_without_bound() -> None:
    """Each of 30 trees calls the next one twice."""
    call = "<Sequence>" + '<SubTree ID="T{0}"/>' * 2 + "</Sequence>"
    trees = "".join(f'<BehaviorTree ID="T{n}">{call.format(n + 1)}</BehaviorTree>' for n in range(30))
    last = '<BehaviorTree ID="T30"><Sleep msec="1"/></BehaviorTree>'
    with pytest.raises(UnprocessableContent, match="one step too many"):
        step('<SubTree ID="T0"/>', trees + last)


# -- there and back ---------------------------------------------------------------------------------------------------

TEXTS = st.text(max_size=12)
NUMBERS = st.integers(-(10**6), 10**6) | st.floats(allow_nan=False, allow_infinity=False, width=32)
NAMES = st.text(string.ascii_letters, min_size=1, max_size=6)
VARIABLES = st.sampled_from(["angle", "who", "first.width"])
VALUES = st.recursive(
    st.none() | st.booleans() | NUMBERS | TEXTS | st.builds(lambda name: {"variable": name}, VARIABLES),
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(TEXTS, inner, max_size=2),
    max_leaves=4,
)
BODIES = st.none() | st.dictionaries(
    st.sampled_from(["value", "unit", "name", "body", "a-b"]) | NAMES, VALUES, max_size=3
)
TITLES = st.text(max_size=20)
IRIS = st.sampled_from(["http://fleet.example/ur5/elbow/actions/rotate", "http://fleet.example/", "urn:x#y"])
LEAVES = st.one_of(
    st.builds(Invoke, action=IRIS, body=BODIES, title=TITLES),
    st.builds(Invoke, kind=IRIS, of=IRIS | st.builds(Variable, VARIABLES), title=TITLES),
    st.builds(Invoke, action=IRIS, triples=st.just('_:body <urn:p> "x\\n" .\n')),
    st.builds(Wait, seconds=st.floats(0, 1000) | st.sampled_from([0.0, 0.001, 0.29, 1.5])),
    st.builds(Wait, condition=st.just("SELECT ?a WHERE { ?a ?b ?c }"), within=st.sampled_from([3600.0, 0.5])),
    st.builds(Wait, until=st.just("2026-11-29T20:00:00Z")),
    st.builds(Confirm, text=TEXTS),
    st.builds(Notify, text=TEXTS),
)


def _branches(inner: st.SearchStrategy[Step]) -> st.SearchStrategy[Step]:
    steps = st.lists(inner, min_size=1, max_size=3).map(tuple)
    return st.one_of(
        st.builds(Sequence, steps=steps, title=TITLES),
        st.builds(FirstOf, steps=steps),
        st.builds(Parallel, steps=steps, anySuffices=st.booleans()),
        st.builds(Repeat, step=inner, times=st.integers(1, 1000)),
    )


TREES: st.SearchStrategy[Step] = st.recursive(LEAVES, _branches, max_leaves=8)
PARAMETERS = (
    Parameter("angle", "number", title="how far", minimum=-1.5, maximum=1e-7, default=-1),
    Parameter("who", "iri"),
    Parameter("count", "integer", default=5),
    Parameter("sure", "boolean", default=True),
)


@given(TREES, st.text(min_size=1, max_size=20), st.booleans(), TEXTS)
def test_a_mission_is_the_same_after_it_was_a_tree(tree: Step, title: str, holds: bool, default: str) -> None:
    named = Sequence((Invoke(name="first", action="http://fleet.example/a"), tree), name="all")
    text = Parameter("text", "text", default=default, options=tuple(dict.fromkeys((default, "b"))))
    mission = Mission(title, named, (*PARAMETERS, text), holds)
    assert read_tree(write_tree(mission), BASE) == mission
    assert len(list(walk(mission.step))) >= 3


TAGS = st.sampled_from(
    [
        "Sequence",
        "Fallback",
        "Parallel",
        "Repeat",
        "Sleep",
        "Delay",
        "SubTree",
        "Action",
        "Condition",
        "Inverter",
        "x:y",
        "Wait",
    ]
)
ATTRIBUTES = st.sampled_from(
    [
        "ID", "name", "action", "kind", "of", "body", "triples", "_description", "_autoremap", "_skipIf", "num_cycles",
        "msec", "delay_msec", "success_count", "failure_count", "text", "seconds", "condition", "within", "until",
    ]
)  # fmt: skip
PORTS = TEXTS | st.sampled_from(
    [
        "Main",
        "Sub",
        "Wait",
        "Notify",
        "{angle}",
        "{=}",
        "{@a}",
        "{",
        "json:",
        "json:{}",
        "json:[[",
        "-1",
        "2",
        "1e999",
        "/a",
        "true",
    ]
)
ELEMENTS = st.recursive(
    st.tuples(TAGS, st.dictionaries(ATTRIBUTES, PORTS, max_size=4), st.just(())),
    lambda inner: st.tuples(
        TAGS, st.dictionaries(ATTRIBUTES, PORTS, max_size=3), st.lists(inner, max_size=3).map(tuple)
    ),
    max_leaves=10,
)


def xml(element: Any) -> str:
    tag, attributes, below = element
    said = "".join(f" {name}={quoteattr(text)}" for name, text in attributes.items())
    return f"<{tag}{said}>{''.join(map(xml, below))}</{tag}>"


@given(ELEMENTS, ELEMENTS)
def test_any_tree_is_a_mission_or_refused(main: Any, sub: Any) -> None:
    content = document(xml(main), f'<BehaviorTree ID="Sub">{xml(sub)}</BehaviorTree>{MODEL}')
    try:
        mission = read_tree(content, BASE)
        check(mission)
    except (BadRequest, UnprocessableContent) as refused:
        assert refused.detail
    else:
        assert read_tree(write_tree(mission), BASE) == mission


@given(st.binary(max_size=200) | st.text(max_size=200).map(str.encode))
def test_any_bytes_are_refused(content: bytes) -> None:
    with pytest.raises((BadRequest, UnprocessableContent)):
        read_tree(content, BASE)
