"""Docstrings name what exists: errors after "Raises", and identifiers in double backticks."""

import ast
import builtins
import re
from collections.abc import Iterator
from functools import cache
from itertools import chain
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = (
    "agents/linked_fleet_agent",
    "gateway/linked_fleet_base",
    "gateway/linked_fleet_gateway",
    "gateway/linked_fleet_identity",
    "gateway/linked_fleet_link",
    "gateway/linked_fleet_runtime",
    "gateway/linked_fleet_state",
    "gateway/linked_fleet_doctor",
    "gateway/linked_fleet_server",
    "gateway/linked_fleet_shacl",
    "gateway/linked_fleet_rdf",
    "gateway/linked_fleet_webhooks",
    "gateway/linked_fleet_valkey",
    "client/linked_fleet_client",
    "client/linked_fleet_demo",
)
MODULES = sorted(
    path
    for package in PACKAGES
    for path in (ROOT / package).rglob("*.py")
    if not {"tests", "node_modules"} & set(path.parts[len(ROOT.parts) :])
)
_RAISES = re.compile(r"\bRaises? ((?:[A-Z]\w+(?:, | and |, and | or )?)+)")
_QUOTED = re.compile(r"``([A-Za-z_][\w.]*)(?:\(\))?``")
_DEFINITIONS = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
WORDS_OF_FORMATS = {"soft_lower_limit", "soft_upper_limit", "up_axis"}
"""Attributes of URDF, and an element of COLLADA."""
EXAMPLES = {"RotateInputRAD", "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw"}


def _texts(tree: ast.Module) -> Iterator[str]:
    """Yield the docstrings, also those of attributes."""
    for node in ast.walk(tree):
        for each in getattr(node, "body", ()) if isinstance(node, _DEFINITIONS) else ():
            match each:
                case ast.Expr(value=ast.Constant(value=str(text))):
                    yield text


def _names(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name) | ast.Attribute(attr=name) | ast.arg(arg=name) | ast.keyword(arg=str(name)):
                yield name
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
                yield name
            case ast.Import(names=names) | ast.ImportFrom(names=names):
                yield from chain.from_iterable((each.name, each.asname or "") for each in names)
            case ast.Constant(value=str(text)) if len(text) < 100:
                yield from re.findall(r"\w+", text)


@cache
def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


def _terms() -> Iterator[str]:
    """Yield the terms of the vocabulary, and names in shapes."""
    for file in (*(ROOT / "shapes").rglob("*.ttl"), *(ROOT / "gateway").rglob("*.ttl")):
        yield from re.findall(r"\w+", file.read_text())


@cache
def _known() -> frozenset[str]:
    """Return the identifiers and words in the code of the product, and the modules."""
    files = {part.removesuffix(".py") for path in MODULES for part in path.relative_to(ROOT).parts}
    used = chain.from_iterable(_names(_tree(path)) for path in MODULES)
    return frozenset({*dir(builtins), *files, *WORDS_OF_FORMATS, *EXAMPLES, *_terms(), *used})


@cache
def _errors() -> frozenset[str]:
    """Return the names of classes that are defined, imported or used by the product, and of built-in errors."""
    found = set(dir(builtins))
    for path in MODULES:
        for node in ast.walk(_tree(path)):
            if isinstance(node, ast.ClassDef):
                found.add(node.name)
            elif isinstance(node, ast.Attribute):
                found.add(node.attr)
            elif isinstance(node, ast.ImportFrom):
                found |= {each.asname or each.name for each in node.names}
    return frozenset(found)


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_what_docstrings_name_exists(path: Path) -> None:
    wrong = list[str]()
    for text in _texts(_tree(path)):
        flat = " ".join(text.split())
        for named in _RAISES.findall(flat):
            wrong += [f"Raises {each}" for each in re.findall(r"[A-Z]\w+", named) if each not in _errors()]
        for named in _QUOTED.findall(flat):
            wrong += [named for part in named.split(".") if part and part not in _known()]
    assert not wrong
