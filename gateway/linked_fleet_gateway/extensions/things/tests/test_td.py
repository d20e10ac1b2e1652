"""Thing Descriptions of a whole small fleet, against the schema of the standard and against what is served."""

import asyncio
import json
from itertools import chain
from typing import Any

import pytest
from pyoxigraph import NamedNode, Triple

from linked_fleet_agent.wire.codec import layout
from linked_fleet_agent.wire.messages import WIRE_VERSION, Description
from linked_fleet_base.errors import BadRequest, UnprocessableContent
from linked_fleet_gateway.actions.admission import validate_action_body
from linked_fleet_gateway.extensions.things.directory import Listing, branches
from linked_fleet_gateway.resources.action_offer import Offer
from linked_fleet_gateway.resources.affordance import Invoke, PutTarget
from linked_fleet_gateway.resources.branches import NO_BRANCHES
from linked_fleet_gateway.resources.json_form import form_of_input
from linked_fleet_gateway.resources.plain_json import parse_json_body
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.tree import Tree
from linked_fleet_identity.rights import ALL, View
from linked_fleet_rdf.vocabulary import LF, ROS, UNIT, VOM
from linked_fleet_state.events import Appeared, Described
from linked_fleet_state.fleet import DESCRIPTION_WAIT_NS, Fleet
from linked_fleet_state.invocations import Invocations
from wot import conforms, fits

BASE = "http://example.org"
TD, JSON = "application/td+json", "application/json"
_URDF = """
<robot name="r">
  <link name="base"/><link name="arm"/><link name="hand"/><link name="tip"/>
  <joint name="a turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="5" velocity="2"/></joint>
  <joint name="slide" type="prismatic"><parent link="arm"/><child link="hand"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.5" effort="5" velocity="0.25"/></joint>
  <joint name="wheel" type="continuous"><parent link="hand"/><child link="tip"/><axis xyz="1 0 0"/></joint>
</robot>
"""
_JOINTS = ("a turn", "slide", "wheel")


def _fleet() -> Fleet:
    fleet = Fleet()
    for name in ("r", "secret"):
        said = Description(
            version=WIRE_VERSION, robot=name, incarnation=1, title=f"The {name}", urdf=_URDF, joints=_JOINTS,
            base="floating", rate_hz=50, layout=layout(len(_JOINTS), True), capabilities=("move", "follow", "stop"),
        )  # fmt: skip
        for event in (Appeared(name, 1), Described(said)):
            fleet.apply(event, 1)
    fleet.apply(Appeared("mute", 1), 1)
    fleet.show_awaited(1 + DESCRIPTION_WAIT_NS)
    return fleet


FLEET = _fleet()


def _tree(sees: View = ALL, *, secured: bool = False) -> Tree:
    return Tree(
        FLEET,
        Invocations(),
        BASE,
        visible_robots=sees,
        branches=NO_BRANCHES.with_branches(*branches()),
        requires_authentication=secured,
    )


def _resource(path: str, tree: Tree | None = None) -> Resource:
    found = (tree or _tree()).resolve(path)
    assert isinstance(found, Resource), path
    return found


def _td(path: str, tree: Tree | None = None) -> dict:
    return json.loads(_resource(path, tree).documents[TD]())


def _things() -> list[str]:
    robots = [each for each in _resource("/").part_paths if each != "/mute/"]
    return ["/", "/mute/", *robots, *chain.from_iterable(_resource(each).part_paths for each in robots)]


@pytest.mark.parametrize("path", _things())
def test_every_thing_has_a_description_by_the_standard(path: str) -> None:
    td = _td(path)
    conforms(td)
    assert td["id"] == BASE + path
    assert _tree().resolve(path.replace("%20", " ")) is not None


@pytest.mark.parametrize("path", _things())
def test_every_form_leads_to_an_existing_operation(path: str) -> None:
    td, tree = _td(path), _tree()
    for name, item in td["properties"].items():
        for form in item["forms"]:
            if name != "things":
                target = _resource("/" + form["href"].split("/", 3)[3].partition("?")[0], tree)
                assert form["contentType"] in (*target.documents, "text/turtle")
                method = form.get("htv:methodName", "GET")
                assert method == "GET" or (target.affords is not None and method in target.affords.methods)
                assert "subprotocol" not in form or target.observable
    for name, action in td["actions"].items():
        invoke = (
            _resource("/" + action["forms"][0]["href"].split("/", 3)[3].partition("?")[0], tree)
            if name != "retrieveThing"
            else None
        )
        assert invoke is None or (
            isinstance(invoke.affords, Invoke) and invoke.affords.offer.takes_body == ("input" in action)
        )


def _schemas(schema: dict[str, Any]) -> list[dict[str, Any]]:
    """Return a schema and its parts."""
    parts = [*schema.get("properties", {}).values(), *schema.get("oneOf", ())]
    parts += [schema["items"]] if "items" in schema else []
    return [schema, *(found for each in parts for found in _schemas(each))]


@pytest.mark.parametrize("path", _things())
def test_each_schema_has_one_type(path: str) -> None:
    """wotpy 0.18 takes no other. Null is permitted beside it."""
    td = _td(path)
    whole = [*td["properties"].values()]
    whole += [each[kind] for each in td["actions"].values() for kind in ("input", "output") if kind in each]
    for schema in (found for each in whole for found in _schemas(each)):
        assert isinstance(schema["type"], str), schema
        assert ({"type": "null"} in schema.get("oneOf", ())) == bool(schema.get("nullable")), schema


@pytest.mark.parametrize("path", _things())
def test_forms_of_one_format_name_it(path: str) -> None:
    """wotpy sends no Accept, and would get Turtle."""
    td = _td(path)
    for item in (*td["properties"].values(), *td["actions"].values()):
        for form in item["forms"]:
            if form["contentType"] == JSON and not form["href"].startswith("ws") and form["op"] != "cancelaction":
                assert form["href"].endswith("?as=json")


@pytest.mark.parametrize("path", _things())
def test_values_are_as_the_description_says(path: str) -> None:
    for name, item in _td(path)["properties"].items():
        if name not in ("annotations", "things"):
            value = json.loads(_resource(f"{path.rstrip('/')}/{name}").documents[JSON]())
            assert value and fits(value, item), (name, value)


def test_unknown_values_are_null() -> None:
    value = json.loads(_resource("/r/slide/translation").documents[JSON]())
    metre = UNIT.M.value
    assert value == {"value": None, "unit": metre, "axis": {"x": 1.0, "y": 0.0, "z": 0.0}, "time": None}
    schema = _td("/r/slide")["properties"]["translation"]["properties"]
    assert schema["unit"] == {"type": "string", "const": metre}
    assert schema["value"]["unit"] == metre


def test_limits_and_alternatives_come_from_the_shape() -> None:
    schema = _td("/r/slide")["actions"]["translate"]["input"]
    assert schema["required"] == ["value", "unit"]
    assert fits({"value": 0.5, "unit": UNIT.M.value}, schema)
    assert fits({"value": 500, "unit": UNIT.MilliM.value}, schema)
    assert not fits({"value": 0.6, "unit": UNIT.M.value}, schema)
    assert not fits({"value": 501, "unit": UNIT.MilliM.value}, schema)
    assert not fits({"value": 0.1, "unit": UNIT.RAD.value}, schema)
    assert not fits({"value": 0.1}, schema)
    assert not fits({"value": 0.1, "unit": UNIT.M.value, "speedScale": 0}, schema)
    wheel = _td("/r/wheel")["actions"]["rotate"]["input"]
    assert not fits({"value": 360, "unit": UNIT.DEG.value}, wheel)


def _writable(schema: object) -> object:
    """Return a schema without read-only parts."""
    if isinstance(schema, dict):
        return {name: _writable(each) for name, each in schema.items()}
    if isinstance(schema, list):
        return [_writable(each) for each in schema if not (isinstance(each, dict) and each.get("readOnly") is True)]
    return schema


@pytest.mark.parametrize(
    ("joint", "name", "unit", "written", "beyond"),
    [
        ("a~20turn", "targetRotation", UNIT.RAD, (-1, 0.5, 1), (1.0000003, -9)),
        ("slide", "targetTranslation", UNIT.M, (0, 0.5), (-0.1, 0.6)),
        ("wheel", "targetRotation", UNIT.RAD, (0, 6.28), (-0.1, 7.0)),
    ],
)
def test_a_target_is_written_within_limits_and_read_as_it_is(
    joint: str, name: str, unit: NamedNode, written: tuple[float, ...], beyond: tuple[float, ...]
) -> None:
    """Null and values beyond the limits can be read, but not written, by both the schema and the guard."""
    schema = _td(f"/r/{joint}")["properties"][name]
    put = _resource(f"/r/{joint}/{name}").affords
    assert isinstance(put, PutTarget)
    for number in (*written, *beyond, None):
        value = {"value": {"value": number, "unit": unit.value}}
        assert fits(value, schema), number
        assert fits(value, _writable(schema)) == (number in written), number
        if number is not None:
            body = parse_json_body(json.dumps(value["value"]).encode(), form_of_input(put.offer, BASE), BASE, 1000)
            assert _admitted(put.offer, body) == (number in written), number
    assert not fits({"value": {"value": 0.1, "unit": UNIT.SEC.value}}, schema)
    assert fits({"value": {"value": 1, "unit": UNIT.DEG.value}}, _writable(schema)) == (unit == UNIT.RAD)


def _admitted(offer: Offer, body: list[Triple]) -> bool:
    try:
        validate_action_body(offer, body, BASE)
    except UnprocessableContent:
        return False
    return True


def test_several_joints_have_their_own_limits() -> None:
    schema = _td("/r/")["actions"]["moveJoints"]["input"]
    slide, turn = f"{BASE}/r/slide", f"{BASE}/r/a~20turn"
    assert fits({"target": [{"joint": slide, "value": 0.4, "unit": UNIT.M.value}]}, schema)
    assert fits({"target": [{"joint": turn, "value": -0.9, "unit": UNIT.RAD.value}]}, schema)
    assert not fits({"target": [{"joint": slide, "value": -0.4, "unit": UNIT.M.value}]}, schema)
    assert not fits({"target": [{"joint": slide, "value": 0.4, "unit": UNIT.RAD.value}]}, schema)
    assert not fits({"target": []}, schema)


_ROTATE = [
    ({"value": 0.5, "unit": UNIT.RAD.value}, True),
    ({"value": 1, "unit": VOM.Radian.value, "speedScale": 1}, True),
    ({"value": 45, "unit": UNIT.DEG.value, "speed": {"value": 0.1, "unit": UNIT.terms["RAD-PER-SEC"].value}}, True),
    ({"value": 45, "unit": UNIT.DEG.value, "speed": {"value": 9, "unit": UNIT.terms["RAD-PER-SEC"].value}}, False),
    ({"value": 1.5, "unit": UNIT.RAD.value}, False),
    ({"value": "0.5", "unit": UNIT.RAD.value}, False),
    ({"value": True, "unit": UNIT.RAD.value}, False),
    ({"value": 0.5}, False),
    ({"value": 0.5, "unit": UNIT.M.value}, False),
    ({"value": 0.5, "unit": UNIT.RAD.value, "speedScale": 2}, False),
    ({"value": 0.5, "unit": UNIT.RAD.value, "precondition": [{"joint": f"{BASE}/r/a~20turn"}]}, False),
]


@pytest.mark.parametrize(("body", "right"), _ROTATE)
def test_the_guard_agrees_with_the_schema(body: dict, right: bool) -> None:
    invoke = _resource("/r/a~20turn/actions/rotate").affords
    assert isinstance(invoke, Invoke)
    assert fits(body, _td("/r/a~20turn")["actions"]["rotate"]["input"]) == right
    triples = parse_json_body(json.dumps(body).encode(), form_of_input(invoke.offer, BASE), BASE, 1000)
    if right:
        admitted = validate_action_body(invoke.offer, triples, BASE)
        assert admitted.number(admitted.root, VOM.numericalValue) == body["value"]
    else:
        with pytest.raises(UnprocessableContent):
            validate_action_body(invoke.offer, triples, BASE)


@pytest.mark.parametrize(
    ("body", "error"),
    [
        (b"", BadRequest), (b"{", BadRequest), (b"\xff", BadRequest), (b'{"value": NaN}', BadRequest),
        (b'{"value": 1, "value": 2}', BadRequest), (b"[" * 100_000, BadRequest), (b'{"value":' * 5000, BadRequest),
        (b"[]", UnprocessableContent), (b"null", UnprocessableContent), (b'{"sped": 1}', UnprocessableContent),
        (b'{"value": null}', UnprocessableContent), (b'{"value": {}}', UnprocessableContent),
        (b'{"value": [1, 2]}', UnprocessableContent), (b'{"precondition": {}}', UnprocessableContent),
        (b'{"precondition": [1]}', UnprocessableContent), (b'{"unit": "%s"}' % (b"x" * 5000), UnprocessableContent),
        (b'{"value": 1%s}' % (b"0" * 5000), UnprocessableContent), (b'{"@id": "x"}', UnprocessableContent),
        (b'{"precondition": [%s{}]}' % (b"{}," * 2000), BadRequest),
    ],
)  # fmt: skip
def test_an_invalid_json_body_is_refused(body: bytes, error: type[Exception]) -> None:
    invoke = _resource("/r/a~20turn/actions/rotate").affords
    assert isinstance(invoke, Invoke)
    with pytest.raises(error):
        parse_json_body(body, form_of_input(invoke.offer, BASE), BASE, 1000)


def test_things_exclude_invisible_robots() -> None:
    tree = _tree(View.of(frozenset({"r"}), "who"), secured=True)
    said = json.dumps(_td("/", tree)) + json.dumps(_td("/.well-known/wot", tree))
    assert "secret" not in said and f"{BASE}/r/" in said
    assert tree.resolve(f"/things/{BASE}/secret/") is None
    assert _td("/", tree)["securityDefinitions"] == {"access": {"scheme": "bearer", "in": "header"}}


def test_the_directory_has_each_thing_once() -> None:
    listing = _resource("/things").remote
    assert isinstance(listing, Listing)
    found = asyncio.run(listing.things())
    assert [id for id, _ in found] == sorted(BASE + path for path in _things())
    for id, place in found:
        assert _td(f"/things/{id}")["id"] == id == json.loads(listing.description(id, place) or b"")["id"]


def test_classes_are_told() -> None:
    assert ROS.RevoluteJoint.value in _td("/r/a~20turn")["@type"]
    assert LF.Robot.value in _td("/r/")["@type"]
