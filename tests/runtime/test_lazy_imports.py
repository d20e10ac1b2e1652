"""Large, rarely needed modules are not loaded at the start, but their absence is noticed then."""

import subprocess
import sys
from pathlib import Path

import pytest

from linked_fleet_base.errors import LibraryMissing
from linked_fleet_base.lazy_imports import LazyModule

LARGE = (
    "pinocchio",
    "numpy",
    "rdflib",
    "pyshacl",
    "httpx",
    "jwt",
    "jinja2",
    "linked_fleet_gateway.extensions.reach.inverse_kinematics",
)


def test_a_gateway_starts_without_large_modules() -> None:
    said = f"import sys, linked_fleet_gateway.app.main; print(*sorted(set({LARGE!r}) & set(sys.modules)))"
    found = subprocess.run([sys.executable, "-c", said], capture_output=True, text=True, check=True)
    assert found.stdout.split() == []


def test_a_lazy_module_is_imported_on_first_access() -> None:
    assert LazyModule("decimal").Decimal("1.5") * 2 == 3


@pytest.mark.parametrize("names", [("no_such_module",), ("json", "no_such_module")])
def test_a_missing_module_is_reported_at_once(names: tuple[str, ...]) -> None:
    with pytest.raises(ModuleNotFoundError, match="no_such_module is not installed"):
        LazyModule(*names)


def test_a_library_that_cannot_be_loaded_is_an_error_with_a_status(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """The log has it once; the module is used as soon as it can be loaded."""
    module = tmp_path / "module_of_this_test.py"
    module.write_text("raise ImportError('libodd.so.3: cannot open shared object file')")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    lazy = LazyModule("module_of_this_test")
    for _ in range(2):
        with pytest.raises(LibraryMissing, match=r"module_of_this_test \(libodd.so.3: cannot open .*doctor"):
            _ = lazy.answer
    assert [each.message for each in caplog.records if "libodd.so.3" in each.message] == [caplog.records[0].message]
    module.write_text("answer = 42")
    assert lazy.answer == 42
