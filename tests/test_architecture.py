"""ARCHITECTURE.md is true: what it names exists, and the settings named in the docs are those of the code."""

import ast
import importlib
import re
from collections import Counter
from pathlib import Path

import pytest

from linked_fleet_gateway.app.extensions import BUILT_IN
from linked_fleet_gateway.resources import joint_kinds as kinds
from linked_fleet_gateway.resources.action_offer import action_definitions
from linked_fleet_gateway.resources.subscription_resource import read_request
from linked_fleet_rdf.serialise import parse

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "ARCHITECTURE.md").read_text()
TREE = (ROOT / "docs/TREE.md").read_text()
PAGES = (
    "README.md",
    "ARCHITECTURE.md",
    "docs/TREE.md",
    "docs/TUTORIAL.md",
    "docs/PAPER.md",
    "CHANGELOG.md",
    "agents/linked_fleet_agent/wire/PROTOCOL.md",
    "gateway/linked_fleet_gateway/actions/PROTOCOL.md",
    "gateway/linked_fleet_gateway/subscriptions/PROTOCOL.md",
    "client/README.md",
    ".github/SECURITY.md",
    "tests/README.md",
    "docs/IDENTITIES.md",
    "docs/THREATS.md",
    "gateway/linked_fleet_gateway/extensions/things/README.md",
    "gateway/linked_fleet_gateway/extensions/openapi/README.md",
    "client/CONFORMANCE.md",
    "docs/FUZZING.md",
    "gateway/linked_fleet_gateway/extensions/cameras/README.md",
    "gateway/linked_fleet_gateway/extensions/mcp/README.md",
    "gateway/linked_fleet_gateway/extensions/foxglove/README.md",
    "gateway/linked_fleet_gateway/extensions/recordings/README.md",
    "docs/BINARY.md",
    "gateway/linked_fleet_gateway/extensions/history/README.md",
    "gateway/linked_fleet_gateway/extensions/query/README.md",
    "docs/SETTINGS.md",
    "gateway/linked_fleet_gateway/extensions/rules/README.md",
    "docs/ROS2.md",
    "docs/DESCRIPTIONS.md",
    "gateway/linked_fleet_gateway/extensions/world/README.md",
    "gateway/linked_fleet_shacl/CONFORMANCE.md",
)
FOLDERS = {path.name for path in ROOT.iterdir() if path.is_dir()}


@pytest.mark.parametrize("page", PAGES)
def test_every_path_that_a_page_names_exists(page: str) -> None:
    text = (ROOT / page).read_text()
    named = {path for path in re.findall(r"`([\w.-]+(?:/[\w.-]+)+)`", text) if path.partition("/")[0] in FOLDERS}
    links = {path for path in re.findall(r"\]\(([^)#:]+)\)", text)}
    assert [path for path in sorted(named) if not (ROOT / path).exists()] == []
    assert [path for path in sorted(links) if not (ROOT / page).parent.joinpath(path).exists()] == []


def test_tests_named_by_the_page_of_threats_exist() -> None:
    named = re.findall(r"`((?:tests|gateway)/[\w/.]+\.py)(?:::(\w+))?`", (ROOT / "docs/THREATS.md").read_text())
    assert len(named) > 30
    texts = {path: (ROOT / path).read_text() for path, test in named if test}
    assert [test for path, test in named if test and f"def {test}(" not in texts[path]] == []
    assert [path for path, _ in named if not (ROOT / path).exists()] == []


def test_architecture_names_many_paths() -> None:
    """Guard the test above: a change of notation must not leave it without paths to check."""
    assert len(set(re.findall(r"`(?:agents|gateway)/[\w./]+`", PAGE))) > 12


def test_the_settings_table_is_what_its_script_writes(monkeypatch: pytest.MonkeyPatch) -> None:
    """``make docs-settings`` writes it."""
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    script = importlib.import_module("settings_table")
    text = script.PAGE.read_text()
    assert text == script.page(text)
    rows = re.findall(
        r"^\| (gateway|gateway, \w+|agents) \| `(\w+)` \| `(--[\w-]+)` \| (?:`(.+)` )?\| .+ \|$", text, re.M
    )
    assert ("gateway", "REDIS_URL", "--redis-url", "") in rows
    assert ("gateway, history", "LINKED_FLEET_HISTORY_S", "--history-s", "300") in rows
    assert ("agents", "LINKED_FLEET_ZENOH_CONNECT", "--connect", "tcp/127.0.0.1:7447") in rows
    assert len(rows) == len(script.table().splitlines()) - 2


def test_the_extensions_that_can_be_switched_off_are_on_the_page() -> None:
    listed = (ROOT / "docs/SETTINGS.md").read_text().partition("## Extensions")[2].partition("## All settings")[0]
    assert re.findall(r"^\| `(\w+)` \|", listed, re.M) == [each.name for each in BUILT_IN]


def test_the_table_of_kinds_is_that_of_the_code() -> None:
    rows = re.findall(r"^\| ([\w, ]+) \| (`.*`) \| (.*) \| .* \| (.*) \|$", TREE, re.M)
    documented = {}
    for names, classes, position, action in rows:
        for name, type_ in zip(names.split(", "), classes.split(", "), strict=True):
            documented[name] = (type_.strip("`").partition(":")[2], re.findall(r"`(\w+)`", position), action)
    for joint, kind in kinds.KINDS.items():
        type_, position, action = documented[joint.value]
        assert kind.type.value.partition("#")[2] == type_
        assert ([kind.position] if kind.position else []) == [one for one in position if one != "pose"]
        offered = {each.segment for each in action_definitions() if kind.type in each.offered_by}
        assert offered == set(re.findall(r"`(\w+)`", action))


def test_the_resolutions_are_those_of_the_code() -> None:
    digits = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
    said = dict(re.findall(r"(position|velocity|effort|pose) 10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)", TREE.replace("\n", " ")))
    assert {name: float(f"1e{power.translate(digits)}") for name, power in said.items()} == {
        "position": kinds.POSITION_RESOLUTION,
        "velocity": kinds.VELOCITY_RESOLUTION,
        "effort": kinds.EFFORT_RESOLUTION,
        "pose": kinds.POSE_RESOLUTION,
    }


def test_the_numbers_of_subscriptions_are_those_of_the_code() -> None:
    text = (ROOT / "gateway/linked_fleet_gateway/subscriptions/PROTOCOL.md").read_text()
    rows = re.findall(r"^\| .* \| ([\d.]+) \| `([\w/]+)\.py` `(\w+)` \|$", text, re.M)
    assert len(rows) > 5
    for value, module, constant in rows:
        assert getattr(importlib.import_module(module.partition("/")[2].replace("/", ".")), constant) == float(value)


def test_the_description_in_the_page_is_one_that_is_taken() -> None:
    text = (ROOT / "gateway/linked_fleet_gateway/subscriptions/PROTOCOL.md").read_text()
    (example,) = re.findall(r"```turtle\n(.*?)```", text, re.S)
    container = "http://fleet.example/baxter/right_s1/subscriptions"
    wanted = read_request(parse(example.encode(), "text/turtle", container), container, "http://fleet.example")
    assert wanted.resource == "http://fleet.example/baxter/right_s1/rotation"
    assert (wanted.interval_s, wanted.deadband) == (0.5, 0.01)


def test_architecture_stays_short() -> None:
    assert len(PAGE.splitlines()) <= 120


def test_of_uvicorn_nothing_but_its_public_classes_is_used() -> None:
    """A new version may change everything else, such as its protocol classes."""
    used = Counter[str]()
    for folder in ("agents", "bench", "client", "gateway", "tests"):
        for path in (ROOT / folder).rglob("*.py"):
            text = path.read_text()
            if "uvicorn" in text:
                used += _names_of_uvicorn(ast.parse(text))
    assert set(used) == {"Config", "Server", "run"}
    assert used["Server"] > 1


def _names_of_uvicorn(module: ast.Module) -> Counter[str]:
    """Return the attributes of ``import uvicorn``, methods that start with an underscore, and other imports."""
    found = Counter[str]()
    for node in ast.walk(module):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "uvicorn":
            found.update(f"{node.module}.{each.name}" for each in node.names)
        elif isinstance(node, ast.Import):
            found.update(each.name for each in node.names if each.name.startswith("uvicorn."))
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            if node.value.id == "uvicorn":
                found[node.attr] += 1
            elif node.value.id == "server" and node.attr.startswith("_"):
                found[f"Server.{node.attr}"] += 1
    return found
