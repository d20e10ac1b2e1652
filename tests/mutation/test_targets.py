"""Targets of ``make mutants`` exist, and only their survivors are explained."""

import re
import tomllib
from importlib.util import find_spec
from pathlib import Path

from mutation.modules import module_name

ROOT = Path(__file__).parents[2]
TARGETS = tomllib.loads(Path(__file__).with_name("targets.toml").read_text())


def test_modules_and_tests_of_each_target_are_there() -> None:
    """Otherwise a moved file would be noticed only in the next run, which is manual."""
    files = [file for target in TARGETS.values() for file in (*target["modules"], *target["tests"])]
    assert [file for file in files if not (ROOT / file).is_file()] == []
    slow = [test.split("::") for target in TARGETS.values() for test in target.get("slow", ())]
    assert [name for file, name in slow if f"def {name}(" not in (ROOT / file).read_text()] == []


def test_each_target_is_named_as_it_is_imported() -> None:
    """A mutant with another name would never be imported, and would survive or be killed for no reason."""
    for file in (file for target in TARGETS.values() for file in target["modules"]):
        spec = find_spec(module_name(file))
        assert spec is not None and spec.origin == str(ROOT / file)


def test_explained_mutants_are_of_functions_that_are_there() -> None:
    modules = {Path(file).stem: ROOT / file for target in TARGETS.values() for file in target["modules"]}
    places = re.findall(r"^\| `(\w+)\.([\w.]*)` \| `", Path(__file__).with_name("survivors.txt").read_text(), re.M)
    assert places
    for module, names in places:
        text = modules[module].read_text()
        assert all(re.search(rf"\b{name}\b", text) for name in names.split(".") if name), (module, names)
