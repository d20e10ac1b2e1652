"""The contract of extensions is one module, and docs/EXTENDING.md describes it completely and truly."""

import dataclasses
import importlib.util
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import msgspec
import pytest

from extending_page import PAGE, example_files
from linked_fleet_gateway import api
from linked_fleet_gateway.extensions.pages import api as pages

ROOT = Path(__file__).parents[3]
MODULES = (api, pages)
MOST_NAMES = 82
"""A stranger reads all of them."""


def _generator() -> ModuleType:
    found = importlib.util.spec_from_file_location("extending_reference", ROOT / "docs" / "extending_reference.py")
    assert found is not None and found.loader is not None
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module


def _ours() -> Iterator[tuple[str, object]]:
    for module in MODULES:
        for name in module.__all__:
            value = getattr(module, name)
            if str(getattr(value, "__module__", "")).startswith("linked_fleet"):
                yield name, value


def test_the_reference_is_that_of_the_code() -> None:
    assert _generator().page(PAGE) == PAGE, "run: make docs-extending"


def test_the_contract_stays_small() -> None:
    assert len(api.__all__) <= MOST_NAMES


@pytest.mark.parametrize("name", [name for module in MODULES for name in module.__all__ if name != "VERSION"])
def test_every_name_is_on_the_page(name: str) -> None:
    assert re.search(rf"`{name}[`(.:]", PAGE)


@pytest.mark.parametrize(("name", "value"), [each for each in _ours() if callable(each[1])])
def test_every_class_and_function_says_what_it_is(name: str, value: object) -> None:
    if inspect.isclass(value) or inspect.isfunction(value):
        assert value.__doc__, name


@pytest.mark.parametrize("cls", [api.Container, api.Core, api.Mount, api.Extension, api.Operation, pages.PageView])
def test_every_field_is_on_the_page(cls: type) -> None:
    fields = [each.name for each in dataclasses.fields(cls)] if dataclasses.is_dataclass(cls) else []
    hooks = [each for each in vars(cls) if not each.startswith("_")]
    assert len({*fields, *hooks}) > 1
    for each in {*fields, *hooks}:
        assert re.search(rf"`{cls.__name__}\.{each}\b", PAGE), each


def test_everything_on_the_page_exists() -> None:
    """Names in backticks such as ``Mount.readers`` or ``core.table(…)``."""
    text = PAGE.partition("## Reference")[0]
    owners = {name: value for name, value in _ours() if inspect.isclass(value)} | {"core": api.Core}
    found = re.findall(rf"`({'|'.join(owners)})\.(\w+)", text)
    assert len(found) > 20
    for owner, member in found:
        cls = owners[owner]
        known = {*dir(cls), *getattr(cls, "__annotations__", {})}
        known |= {each.name for each in msgspec.structs.fields(cls)} if issubclass(cls, msgspec.Struct) else set()
        assert member in known, f"{owner}.{member}"


def test_examples_import_nothing_but_the_contract() -> None:
    for name in ("odometer", "stations"):
        code = example_files(name)[f"{name}.py"]
        modules = set(re.findall(r"^from (linked_fleet[\w.]*) import", code, re.MULTILINE))
        assert modules <= {api.__name__, pages.__name__}


def test_the_stations_take_a_hundred_lines() -> None:
    assert 0 < example_files("stations")["stations.py"].count("\n") <= 100
