"""Large, rarely needed modules are not loaded at the start, but their absence is noticed then."""

import subprocess
import sys

import pytest

from linked_fleet_gateway.base.lazy_imports import LazyModule

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
    said = f"import sys, linked_fleet_gateway.__main__; print(*sorted(set({LARGE!r}) & set(sys.modules)))"
    found = subprocess.run([sys.executable, "-c", said], capture_output=True, text=True, check=True)
    assert found.stdout.split() == []


def test_a_lazy_module_is_imported_on_first_access() -> None:
    assert LazyModule("decimal").Decimal("1.5") * 2 == 3


@pytest.mark.parametrize("names", [("no_such_module",), ("json", "no_such_module")])
def test_a_missing_module_is_reported_at_once(names: tuple[str, ...]) -> None:
    with pytest.raises(ModuleNotFoundError, match="no_such_module is not installed"):
        LazyModule(*names)
