"""The core names no extension: neither in its code, nor in the Turtle of shapes/."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import linked_fleet_gateway
from linked_fleet_gateway.app.extensions import BUILT_IN
from linked_fleet_rdf.vocabulary import LF

CORE = Path(linked_fleet_gateway.__path__[0])
BELOW = [CORE.with_name(f"linked_fleet_{each}") for each in ("base", "identity", "link", "rdf", "runtime", "state")]
SHAPES = Path(__file__).parents[1] / "shapes" / "linked_fleet_shapes"
NAMES = {name for each in BUILT_IN for name in (each.name, *each.at_root, *each.in_robot)}
"""The extensions, and the segments that are theirs."""
WORDS = {
    ("linked_fleet_gateway/app/metrics.py", "faults"),  # a metric: faults of the gateway itself
    ("linked_fleet_state/answers.py", "components"),  # a member of descriptions (PROTOCOL.md of the wire)
    ("linked_fleet_identity/issuers.py", ".well-known"),  # OpenID Connect Discovery, 4
    ("linked_fleet_gateway/subscriptions/redis_scripts.py", "queue"),  # the key of deliveries that are queued
    ("linked_fleet_gateway/resources/properties.py", "world"),  # the name of a frame of reference, as ROS has it
}
"""Strings that mean something else, by file."""


def named_in(source: str) -> Iterator[str]:
    """The names in string constants, as a whole or as a part of a path; docstrings apart."""
    tree = ast.parse(source)
    said = {id(each.value) for each in ast.walk(tree) if isinstance(each, ast.Expr)}
    for each in ast.walk(tree):
        if isinstance(each, ast.Constant) and isinstance(each.value, str) and id(each) not in said:
            yield from NAMES.intersection(re.split(r"[/:]|\.ttl$", each.value))


def imported_in(source: str) -> Iterator[str]:
    for each in ast.walk(ast.parse(source)):
        modules = [each.module or ""] if isinstance(each, ast.ImportFrom) else []
        modules += [name.name for name in each.names] if isinstance(each, ast.Import) else []
        yield from (name for name in modules if name.startswith("linked_fleet_gateway.extensions."))


def test_no_module_of_the_core_names_an_extension() -> None:
    modules = [path for path in CORE.rglob("*.py") if "extensions" not in path.relative_to(CORE).parts[:-1]]
    modules += [path for folder in BELOW for path in folder.glob("*.py")]
    assert len(modules) > 150
    found = {
        (str(path.relative_to(CORE.parent)), name)
        for path in modules
        for name in (*named_in(path.read_text()), *imported_in(path.read_text()))
    }
    assert found == WORDS


def test_no_term_and_no_shape_of_the_core_names_an_extension() -> None:
    assert not NAMES.intersection(LF.terms)
    named = {term for file in SHAPES.rglob("*.ttl") for term in re.findall(r"\blf:(\w+)", file.read_text())}
    assert len(named) > 150
    assert not NAMES & named


def test_the_terms_of_extensions_are_described_with_them_alone() -> None:
    theirs = {
        term
        for each in BUILT_IN
        for file in each.vocabulary
        for term in re.findall(r"^lf:(\w+) a ", file.read_text(), re.M)
    }
    assert "collisionFree" in theirs and len(theirs) > 50
    assert not theirs.intersection(LF.terms)
    assert not theirs & {term for file in SHAPES.rglob("*.ttl") for term in re.findall(r"\blf:(\w+)", file.read_text())}


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ('x = "/world"', {"world"}),
        ('x = robot + "cameras"', {"cameras"}),
        ('FILES = ("blueprints.ttl", "rules.ttl")', {"rules"}),
        ('x = f"/world/{name}"', {"world"}),
        ('"""The world."""', set()),
        ('raise ValueError("the rules of the query are others")', set()),
    ],
)
def test_names_are_found_where_they_mean_an_extension(source: str, found: set[str]) -> None:
    assert set(named_in(source)) == found
