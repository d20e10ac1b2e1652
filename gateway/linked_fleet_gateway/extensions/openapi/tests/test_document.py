"""The description is complete and true, and contains nothing of robots that the caller may not see."""

import asyncio
import json
from collections.abc import Iterator
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from schemathesis.specs.openapi.definitions import OPENAPI_31_VALIDATOR

from linked_fleet_gateway.extensions.openapi.extension import Documents
from linked_fleet_gateway.http.read import allowed_methods
from linked_fleet_gateway.resources.branches import RequestView
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.tree import Tree
from sample_resources import BASE, tree

_METHODS = {"get", "put", "post", "patch", "delete"}


def _view(*hidden: str, secured: bool = False) -> RequestView:
    found = tree().resolve("/things")
    assert isinstance(found, Resource)
    view: RequestView = found.remote.view  # type: ignore[union-attr, attr-defined]
    robots = {name: robot for name, robot in view.robots.items() if name not in hidden}
    return RequestView(BASE, robots, view.invocations, view.visible_robots, secured)


def _described(*hidden: str, secured: bool = False) -> dict[str, Any]:
    return dict(json.loads(asyncio.run(Documents(()).document(_view(*hidden, secured=secured))).body))


@pytest.fixture(scope="module")
def whole() -> dict[str, Any]:
    return _described()


def _paths(template: str, item: dict[str, Any]) -> list[str]:
    """Return the template with every listed name of each parameter."""
    paths = [template]
    for parameter in item.get("parameters", ()):
        names = parameter["schema"].get("enum", [])
        paths = [path.replace(f"{{{parameter['name']}}}", name) for path in paths for name in names]
    return paths


def test_the_description_is_valid_openapi_3_1(whole: dict[str, Any]) -> None:
    """By the schema included in schemathesis."""
    errors = [f"{each.instance_path}: {each.message[:200]}" for each in OPENAPI_31_VALIDATOR.iter_errors(whole)]
    assert not errors, errors[:5]


def test_every_path_is_in_the_tree_and_has_the_methods_that_are_described(whole: dict[str, Any]) -> None:
    """Not every robot has each joint, but each listed name exists somewhere."""
    resources: Tree = tree()
    for template, item in whole["paths"].items():
        if template in ("/openapi.json", "/audit", "/health/live") or "{invocation}" in template:
            continue
        found = [each for path in _paths(template, item) if isinstance(each := resources.resolve(path), Resource)]
        assert found, template
        for resource in found:
            methods = {method.lower() for method in allowed_methods(resource)} - {"head", "options"}
            assert methods == _METHODS & item.keys(), f"{template}: {resource.path}"


def test_every_reference_leads_to_a_component_and_operations_have_names_of_their_own(whole: dict[str, Any]) -> None:
    text = json.dumps(whole)
    operations = [item[method] for item in whole["paths"].values() for method in _METHODS & item.keys()]
    names = [each["operationId"] for each in operations]
    assert len(set(names)) == len(names)
    for part in text.split('"$ref": "')[1:]:
        _, kind, name = part.partition('"')[0].removeprefix("#/").split("/")
        assert name in whole["components"][kind]
    links = [
        link
        for each in operations
        for answer in each["responses"].values()
        for link in answer.get("links", {}).values()
    ]
    assert links and {link["operationId"] for link in links} <= set(names)


def test_every_schema_is_one_and_takes_its_examples(whole: dict[str, Any]) -> None:
    components = {"components": whole["components"]}
    for schema in whole["components"]["schemas"].values():
        Draft202012Validator.check_schema(schema)
    bodies = [
        body
        for item in whole["paths"].values()
        for method in _METHODS & item.keys()
        for body in item[method].get("requestBody", {}).get("content", {}).values()
    ]
    examples = [(body["schema"], each["value"]) for body in bodies for each in body.get("examples", {}).values()]
    assert len(examples) > 5
    for schema, value in examples:
        Draft202012Validator(components | schema).validate(value)


@pytest.mark.parametrize("hidden", [("floating",), ("fixed", "floating"), ("fixed", "floating", "faulty", "mute")])
def test_invisible_robots_are_not_in_the_description(hidden: tuple[str, ...]) -> None:
    """Neither names of hidden robots nor IRIs of their joints are served."""
    text = json.dumps(_described(*hidden))
    for name in hidden:
        assert f"{BASE}/{name}/" not in text and f'"{name}"' not in text.replace('"const": "floating"', "")


def test_the_description_names_the_authentication_schemes(whole: dict[str, Any]) -> None:
    assert "security" not in whole and "securitySchemes" not in whole["components"]
    secured = _described(secured=True)
    assert secured["security"] == [{"bearer": []}]
    assert secured["components"]["securitySchemes"]["bearer"] == {"type": "http", "scheme": "bearer"}
    assert "401" in secured["paths"]["/"]["get"]["responses"]


async def test_a_description_is_made_once_while_nothing_changes() -> None:
    documents = Documents(())
    first = await documents.document(_view())
    assert await documents.document(_view()) is first
    assert await documents.document(_view("floating")) != first
    assert await documents.document(_view()) is first


# -- what generators need (tried with openapi-generator 7.10 for Java, typescript-fetch and Python) --------------------


def _schemas(node: Any) -> Iterator[dict[str, Any]]:
    if isinstance(node, dict):
        yield node
    for each in node.values() if isinstance(node, dict) else node if isinstance(node, list) else ():
        yield from _schemas(each)


@pytest.mark.parametrize("secured", [False, True])
def test_successes_come_before_errors(secured: bool) -> None:
    """A generated client accepts the first media type of JSON that it finds."""
    for _, _, operation in _operations(_described(secured=secured)):
        statuses = [*operation["responses"]]
        assert statuses == sorted(statuses, key=lambda each: (each[0] != "2", each)), operation["operationId"]
        assert statuses[0][0] == "2"


def test_a_value_that_may_be_unknown_has_two_types() -> None:
    """Generators make classes of ``oneOf`` a type and null that do not compile."""
    described = _described()
    halves = [each for each in _schemas(described) if {"type": "null"} in each.get("oneOf", ())]
    assert all("oneOf" in other for each in halves for other in each["oneOf"] if other != {"type": "null"})
    both = [each for each in _schemas(described) if each.get("type") == ["number", "null"]]
    assert both and all("oneOf" not in each for each in both)
    listed = [each for each in _schemas(described) if isinstance(each.get("type"), list) and "enum" in each]
    assert all(None in each["enum"] for each in listed)


def test_bodies_in_json_are_named_and_no_two_classes_have_one_name() -> None:
    """Generators name parameters ``{operationId}Request``, and so they do a body without a name."""
    described = _described()
    schemas = {name.casefold() for name in described["components"]["schemas"]}
    assert len(schemas) == len(described["components"]["schemas"])
    for _, _, operation in _operations(described):
        body = operation.get("requestBody", {}).get("content", {}).get("application/json", {}).get("schema", {})
        assert "$ref" in body or not {"properties", "oneOf"} & body.keys(), operation["operationId"]
        assert f"{operation['operationId']}request".casefold() not in schemas
    assert "ControlLeaseInput" in described["components"]["schemas"]


def _operations(described: dict[str, Any]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    for path, item in described["paths"].items():
        for method in item.keys() & {"get", "put", "post", "patch", "delete"}:
            yield path, method, item[method]
