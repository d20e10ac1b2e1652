"""docs/FAULTS.md names only what exists: each test, each file, and each bound with its value in the code."""

import importlib
import re
from pathlib import Path

import pytest

from linked_fleet_gateway.app.settings import GatewaySettings

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "FAULTS.md").read_text()
_TABLE = PAGE.partition("## Clients that cost too much")[2].partition("|---|---|---|\n")[2].partition("\n\n")[0]
BOUNDS = [tuple(cell.strip() for cell in row.strip("|").split(" | ")) for row in _TABLE.splitlines()]
SETTINGS = {f"`{each.variable}`": each.default for each in GatewaySettings.settings()}


def test_every_file_that_is_named_exists() -> None:
    named = set(re.findall(r"`((?:tests|gateway|agents)/[\w/]+\.py)`", PAGE))
    assert len(named) > 20
    assert not [name for name in sorted(named) if not (ROOT / name).is_file()]


def constant(file: str, name: str) -> float:
    value = getattr(importlib.import_module(file.removesuffix(".py").replace("/", ".")), name)
    assert isinstance(value, int | float)
    return value


@pytest.mark.parametrize(("bound", "value", "where"), BOUNDS)
def test_every_bound_on_clients_is_that_of_its_constant_or_setting(bound: str, value: str, where: str) -> None:
    """A row names the constant or setting that it states, or the test that measures it."""
    if named := re.fullmatch(r"`(gateway/[\w/]+\.py)` `(\w+)`", where):
        assert constant(*named.groups()) == float(value)
    elif where in SETTINGS:
        assert SETTINGS[where] == value
    else:
        assert f"more than {value} ms" in (ROOT / where.strip("`")).read_text()


def test_there_are_bounds_to_look_at() -> None:
    assert len(BOUNDS) > 25


@pytest.mark.parametrize(
    "path",
    [
        *(f"gateway/linked_fleet_gateway/http/{name}.py" for name in ("invoke", "body", "writes")),
        "gateway/linked_fleet_gateway/extensions/world/extension.py",
        "gateway/linked_fleet_gateway/extensions/sessions/login.py",
    ],
)
def test_every_bound_on_bodies_is_on_the_page(path: str) -> None:
    for name in re.findall(r"^(MAX_\w*(?:BYTES|TRIPLES)) =", (ROOT / path).read_text(), re.MULTILINE):
        assert f"`{path}` `{name}`" in PAGE


def test_threats_refer_to_the_bounds_and_repeat_none() -> None:
    text = (ROOT / "docs" / "THREATS.md").read_text()
    assert "FAULTS.md#clients-that-cost-too-much" in text
    assert re.findall(r"\d[\d,.]* (?:KiB|MiB|ms|triples|triangles|objects)\b", text) == []


@pytest.mark.parametrize(
    ("page", "words", "file", "name", "unit"),
    [
        (
            "gateway/linked_fleet_gateway/extensions/world/README.md",
            r"at most ([\d,]+) triangles",
            "gateway/linked_fleet_gateway/extensions/world/scene.py",
            "MAX_TRIANGLES",
            1,
        ),
        (
            "gateway/linked_fleet_gateway/extensions/world/README.md",
            r"in a body of at most (\d+) KiB",
            "gateway/linked_fleet_gateway/extensions/world/extension.py",
            "MAX_BODY_BYTES",
            2**10,
        ),
        (
            "gateway/linked_fleet_gateway/extensions/rules/README.md",
            r"at most (\d+) triples",
            "gateway/linked_fleet_gateway/extensions/rules/template.py",
            "MOST_TRIPLES",
            1,
        ),
        (
            "gateway/linked_fleet_gateway/extensions/query/README.md",
            r"A result has at most (\d+) MiB",
            "gateway/linked_fleet_gateway/extensions/query/service.py",
            "MAX_RESULT_BYTES",
            2**20,
        ),
        (
            "docs/IDENTITIES.md",
            r"one every (\d+) s is not",
            "gateway/linked_fleet_gateway/extensions/sessions/login.py",
            "REFILL_S",
            1,
        ),
    ],
)
def test_pages_for_users_state_the_same_bounds(page: str, words: str, file: str, name: str, unit: int) -> None:
    (said,) = re.findall(words, (ROOT / page).read_text())
    assert int(said.replace(",", "")) * unit == constant(file, name)


def test_every_test_of_faults_is_on_the_page() -> None:
    there = {f"tests/fleet/{each.name}" for each in (ROOT / "tests" / "fleet").glob("test_fault_*.py")}
    assert not sorted(name for name in there if f"`{name}`" not in PAGE)
