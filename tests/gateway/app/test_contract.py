"""The contract of extensions is one module, and docs/EXTENDING.md describes it completely and truly."""

import ast
import dataclasses
import importlib.util
import inspect
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import msgspec
import pytest

import linked_fleet_gateway.extensions
from extending_page import PAGE, example_files
from linked_fleet_gateway import api, faces, serving
from linked_fleet_gateway.extensions.openapi import api as openapi
from linked_fleet_gateway.extensions.pages import api as pages

ROOT = Path(__file__).parents[3]
DOORS = {api: 92, faces: 70, serving: 46}
"""The modules of the core that extensions import, and the most names of each: a stranger reads all of them."""
MODULES = (*DOORS, pages, openapi)
FOLDER = Path(linked_fleet_gateway.extensions.__path__[0])


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


@pytest.mark.parametrize(("door", "most"), DOORS.items())
def test_the_contract_stays_small(door: ModuleType, most: int) -> None:
    assert len(door.__all__) <= most


@pytest.mark.parametrize("door", [faces, serving])
def test_every_name_is_used_by_an_extension(door: ModuleType) -> None:
    """Foreign extensions need mostly ``api``; a name of the others that no built-in one needs has no reason."""
    used = {
        each.name
        for path in FOLDER.rglob("*.py")
        if "tests" not in path.parts
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ImportFrom) and node.module == door.__name__
        for each in node.names
    }
    assert used == {name for name in door.__all__ if name != "VERSION"}


@pytest.mark.parametrize(
    ("planted", "kept"),
    [
        ("", True),
        ("from linked_fleet_gateway.http.fields import field", False),
        ("import linked_fleet_gateway.subscriptions.live", False),
        ("from linked_fleet_link.fleet_link import FleetLink", False),
    ],
)
def test_import_linter_refuses_other_imports_of_the_core(tmp_path: Path, planted: str, kept: bool) -> None:
    shutil.copytree(FOLDER.parent, tmp_path / "linked_fleet_gateway", ignore=shutil.ignore_patterns("assets", "tests"))
    with (tmp_path / "linked_fleet_gateway/extensions/reach/extension.py").open("a") as file:
        file.write(f"\n{planted}\n")
    (contract,) = [each for each in _importlinter()["contracts"] if each.get("id") == "doors"]
    fields = "\n".join(f"{name} = {json.dumps(value)}" for name, value in contract.items())
    config = tmp_path / "contract.toml"
    config.write_text(
        '[tool.importlinter]\nroot_package = "linked_fleet_gateway"\ninclude_external_packages = true\n'
        f"[[tool.importlinter.contracts]]\n{fields}\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", "import sys; from importlinter.cli import lint_imports_command as run; run()",
         "--config", str(config), "--no-cache"],
        capture_output=True, text=True, check=False, cwd=tmp_path, env=os.environ | {"PYTHONPATH": str(tmp_path)},
    )  # fmt: skip
    assert ("1 kept, 0 broken" in done.stdout, done.returncode == 0) == (kept, kept), done.stdout + done.stderr


def _importlinter() -> Any:
    return tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]


@pytest.mark.parametrize("name", [name for module in MODULES for name in module.__all__ if name != "VERSION"])
def test_every_name_is_on_the_page(name: str) -> None:
    assert re.search(rf"`{name}[`(.:]", PAGE)


@pytest.mark.parametrize(("name", "value"), [each for each in _ours() if callable(each[1])])
def test_every_class_and_function_says_what_it_is(name: str, value: object) -> None:
    if inspect.isclass(value) or inspect.isfunction(value):
        assert value.__doc__, name


_WHOLE = (
    api.Container, api.Content, api.Core, api.Mount, api.Extension, api.Operation, pages.PageView, faces.Describer,
    faces.Form, faces.Identity, faces.Measurement, faces.View, serving.Authenticated, serving.Caller, serving.Worker,
)  # fmt: skip


@pytest.mark.parametrize("cls", _WHOLE)
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
