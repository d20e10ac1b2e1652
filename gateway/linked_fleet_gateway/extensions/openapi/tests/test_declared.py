"""Components are described: their values, events and actions, and the gateway takes and sends what is described."""

import json
from collections.abc import Iterator
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from schemathesis.specs.openapi.definitions import OPENAPI_31_VALIDATOR

from browser import Browser
from component_cell import Cell
from fake_robots import FakeRobot, open_session
from linked_fleet_agent.components import Call, Component, action, value
from linked_fleet_agent.robots.of_components import RobotOfComponents
from linked_fleet_gateway.extensions.openapi.declared import Names, any_of
from linked_fleet_gateway.extensions.openapi.schemas import example, has_example, merge_null
from running import eventually
from small_fleet import Place
from virtual.processes import serving_robot

pytestmark = pytest.mark.virtual
JSON = "application/json"
_METHODS = {"get", "put", "post", "patch", "delete"}


class Gripper(Component, blocking=False, rate_hz=100):
    """A suction cup, which has the name of the gripper of the cell and little else."""

    @value
    def width(self) -> str:
        return "none"

    @action()
    async def grasp(self, call: Call[None], name: str) -> None:
        """Suck."""


class Text(Component, blocking=False, rate_hz=100):
    """A component whose names are no words of an operation."""

    name = "größe"

    @value
    def on(self) -> bool:
        return True

    @value
    def rotation(self) -> str:
        return "word for word"

    @action()
    async def rotate(self, call: Call[None], text: str) -> None:
        """Translate a text."""


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    place, other = Place(tmp_path_factory.mktemp("state")), RobotOfComponents("Cup", Gripper(), Text())
    with (
        place.gateway() as (_, browser),
        open_session(place.zenoh) as session,
        serving_robot(place.zenoh, "cell", Cell()),
        serving_robot(place.zenoh, "cup", other),
    ):
        arm = FakeRobot(session, "arm").appear().stand(0.25)
        eventually(lambda: _value(browser, f"{arm.name}/elbow/rotation"), "the arm")
        for path, member in (("cell/lamp/count", 3), ("cup/gripper/width", "none")):
            eventually(lambda path=path, member=member: _value(browser, path) == member, "the components")  # type: ignore[misc]
        yield browser


def _value(browser: Browser, path: str) -> Any:
    answer = browser.http.get(browser.root + path, headers={"accept": JSON})
    return answer.json()["value"] if answer.status_code == 200 else None


@pytest.fixture(scope="module")
def whole(browser: Browser) -> dict[str, Any]:
    return dict(browser.http.get(browser.root + "openapi.json", headers={"accept": JSON}).json())


def _resolved(whole: dict[str, Any], schema: dict[str, Any]) -> Draft202012Validator:
    return Draft202012Validator({**schema, "components": whole["components"]})


def _names(item: dict[str, Any]) -> dict[str, list[str]]:
    return {each["name"]: each["schema"]["enum"] for each in item["parameters"]}


def test_values_events_and_actions_have_paths(whole: dict[str, Any]) -> None:
    paths = whole["paths"]
    assert _names(paths["/{robot}/{component}/width"]) == {"robot": ["cell", "cup"], "component": ["gripper"]}
    assert _names(paths["/{robot}/{component}/on"])["component"] == ["lamp", "gr~C3~B6~C3~9Fe"]
    assert {"get", "put"} <= paths["/{robot}/{component}/on"].keys()
    assert "put" not in paths["/{robot}/{component}/width"]
    for path in ("/{robot}/{component}/lost", "/{robot}/{component}/actions/grasp"):
        assert path in paths
    assert "gripper" in _names(paths["/{robot}/{part}"])["part"]


def test_the_description_is_valid(whole: dict[str, Any]) -> None:
    assert not [each.message[:200] for each in OPENAPI_31_VALIDATOR.iter_errors(whole)]
    ids = [item[method]["operationId"] for item in whole["paths"].values() for method in _METHODS & item.keys()]
    assert len(ids) == len(set(ids))


_READ = (
    *("cell/gripper/width", "cup/gripper/width", "cell/lamp/on", "cell/lamp/colour", "cell/lamp/pieces"),
    *("cell/lamp/count", "cell/gripper/lost", "cell/gripper/opened", "arm/elbow/rotation"),
    "cup/gr~C3~B6~C3~9Fe/rotation",
)


@pytest.mark.parametrize("path", _READ)
def test_what_is_read_conforms_to_what_is_described(browser: Browser, whole: dict[str, Any], path: str) -> None:
    name = path.rpartition("/")[2]
    kind = "{part}" if name == "rotation" else "{component}"  # what joints have too
    item = whole["paths"][f"/{{robot}}/{kind}/{name}"]
    validator = _resolved(whole, item["get"]["responses"]["200"]["content"][JSON]["schema"])
    validator.validate(browser.http.get(browser.root + path, headers={"accept": JSON}).json())
    assert not validator.is_valid({})


@pytest.mark.parametrize("path", ["cell/gripper", "cell/lamp", "cup/gripper"])
def test_the_values_of_a_component_conform_to_what_is_described(
    browser: Browser, whole: dict[str, Any], path: str
) -> None:
    read = whole["paths"]["/{robot}/{part}"]["get"]
    (pick,) = (each["schema"] for each in read["parameters"] if each.get("name") == "as")
    assert pick == {"type": "string", "enum": ["jsonld", "json"], "default": "jsonld"}, "joints have RDF alone"
    validator = _resolved(whole, read["responses"]["200"]["content"][JSON]["schema"])
    values = browser.http.get(f"{browser.root}{path}", headers={"accept": JSON}).json()
    validator.validate(values)
    assert not validator.is_valid({}), "a component names all of its values"
    assert not validator.is_valid(values | {next(iter(values)): {"no": "value"}})


def test_feedback_and_output_of_an_invocation_conform_to_what_is_described(
    browser: Browser, whole: dict[str, Any]
) -> None:
    template = "/{robot}/{component}/actions/grasp"
    created = whole["paths"][template]["post"]["responses"]["201"]["content"][JSON]["schema"]
    read = whole["paths"][template + "/invocations/{invocation}"]["get"]["responses"]["200"]["content"][JSON]["schema"]
    assert created == read != {"$ref": "#/components/schemas/Invocation"}
    fields = {"accept": JSON, "prefer": "return=representation, wait=10"}
    answer = browser.http.post(f"{browser.root}cell/gripper/actions/grasp", json={"force": 20}, headers=fields)
    said = browser.http.get(answer.headers["location"], headers={"accept": JSON}).json()
    assert said["state"].endswith("#succeeded")
    assert "output" in said
    validator = _resolved(whole, read)
    validator.validate(said)
    assert not validator.is_valid(said | {"output": "none"})


def test_the_examples_are_accepted_and_conform(browser: Browser, whole: dict[str, Any]) -> None:
    tried = 0
    for template, item in whole["paths"].items():
        for method in {"post", "put"} & item.keys():
            body = item[method].get("requestBody")
            if body is None or "{component}" not in template:
                continue
            (example,) = body["content"][JSON]["examples"].values()
            _resolved(whole, body["content"][JSON]["schema"]).validate(example["value"])
            robot, component = (_names(item)[each][0] for each in ("robot", "component"))
            url = browser.root[:-1] + template.replace("{robot}", robot).replace("{component}", component)
            fields = {"content-type": JSON, "prefer": "dry-run"}
            answer = browser.http.request(method, url, content=json.dumps(example["value"]), headers=fields)
            assert answer.status_code == 200, f"{method} {url}: {answer.text}"
            tried += 1
    assert tried == 4  # grasp, paint, and on twice: as PUT and as action


def test_a_body_of_one_name_may_be_that_of_either_component(whole: dict[str, Any]) -> None:
    invoke = whole["paths"]["/{robot}/{component}/actions/grasp"]["post"]
    assert invoke["operationId"] == "invokeGraspOfComponent"
    assert not invoke["requestBody"]["required"], "the gripper of the cell needs none"
    validator = _resolved(whole, invoke["requestBody"]["content"][JSON]["schema"])
    for body, is_valid in (({"force": 20}, True), ({"name": "a"}, True), ({"force": 71}, False), ({"on": 1}, False)):
        assert validator.is_valid(body) is is_valid, body


def test_an_action_that_a_joint_and_a_component_have_takes_the_body_of_either(whole: dict[str, Any]) -> None:
    invoke = whole["paths"]["/{robot}/{part}/actions/rotate"]["post"]
    validator = _resolved(whole, invoke["requestBody"]["content"][JSON]["schema"])
    for body in ({"text": "a"}, {"value": 0.05, "unit": "http://qudt.org/vocab/unit/RAD"}):
        assert validator.is_valid(body), body
    assert not validator.is_valid({"text": "a", "value": 0.05})


def test_names_are_plain_and_each_there_once() -> None:
    names = Names()
    assert [names.new(each) for each in ("ReadGr~C3", "ReadGr_C3", "On", "OnInput", "CancelOn", "Off")] == [
        "ReadGr_C3", "ReadGr_C32", "On", "OnInput2", "CancelOn2", "Off",
    ]  # fmt: skip


def test_too_many_schemas_of_one_name_are_not_listed() -> None:
    assert any_of({"const": each} for each in range(17)) == {}
    assert any_of([{"type": "string"}] * 17) == {"type": "string"}


def test_a_constant_may_be_null() -> None:
    found = merge_null({"oneOf": [{"type": "string", "const": "a"}, {"type": "null"}]})
    assert found == {"type": ["string", "null"], "enum": ["a", None]}


@pytest.mark.parametrize(
    ("schema", "value"),
    [
        ({"type": "string", "const": "a"}, "a"),
        ({"type": "boolean"}, True),
        ({"type": "integer", "minimum": 1, "maximum": 4}, 2),
        ({"type": "string", "minLength": 14}, "Linked Fleet.."),
        ({"type": "string", "maxLength": 6}, "Linked"),
        ({"type": "array", "items": {"type": "boolean"}, "minItems": 2}, [True, True]),
        ({"type": "object"}, {}),
    ],
)
def test_examples_conform(schema: dict[str, Any], value: Any) -> None:
    found = example(schema)
    assert (found, type(found)) == (value, type(value))
    Draft202012Validator(schema).validate(found)


def test_a_text_with_a_pattern_has_no_example() -> None:
    assert not has_example({"type": "object", "properties": {"name": {"type": "string", "pattern": "^a+$"}}})
