"""Makefile: programs that make installs."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from running import ROOT

_PROGRAMS = ("sh", "id", "grep", "date")
_EXTENSIONS = ROOT / "gateway/linked_fleet_gateway/extensions"


def _make(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [shutil.which("make") or "make", *arguments]
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("MAKE", "MFLAGS"))}
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("name", ["wrld", "", "../http"])
def test_an_unknown_extension_is_refused_with_the_names_of_all(name: str) -> None:
    done = _make("test-extension", f"NAME={name}")
    known = sorted(folder.parent.name for folder in _EXTENSIONS.glob("*/tests"))
    assert done.returncode == 2
    assert f"NAME={name} is no extension with tests: {' '.join(known)}\n" in done.stdout


def test_the_tests_of_an_extension_need_the_environment_alone() -> None:
    """Everything that would run, if nothing was there."""
    commands = _make("test-extension", "NAME=world", "--dry-run", "--always-make").stdout
    assert "pytest -rs gateway/linked_fleet_gateway/extensions/world/tests" in commands
    assert "[dev" not in commands
    assert [name for name in ("npm", "chromium", "libegl", "helm", "pip download") if name in commands] == []


@pytest.mark.parametrize(("target", "needs"), [("test", False), ("test-long", True)])
def test_go_java_and_rust_are_for_the_longer_tests(target: str, needs: bool) -> None:
    commands = _make(target, "--dry-run", "--always-make").stdout
    assert [each in commands for each in ("helm_program", "java", "ros2/peers/build")] == [needs] * 3


@pytest.mark.parametrize(("candidate", "installs"), [("150.0.1-1", True), ("(none)", False)])
def test_chromium_is_installed_where_the_system_has_its_package(candidate: str, installs: bool, tmp_path: Path) -> None:
    """Ubuntu has none. apt would take another one there, which installs nothing in a container."""
    for name in _PROGRAMS:
        (tmp_path / name).symlink_to(shutil.which(name) or name)
    said = tmp_path / "said"
    scripts = {
        "apt-get": f'echo "$@" >> {said}',
        "apt-cache": f"echo '  Candidate: {candidate}'",
        "sudo": 'shift; "$@"',
    }
    for name, script in scripts.items():
        (tmp_path / name).write_text(f"#!/bin/sh\n{script}\n")
        (tmp_path / name).chmod(0o755)
    command = [shutil.which("make") or "make", "chromium"]
    done = subprocess.run(command, cwd=ROOT, env={"PATH": str(tmp_path)}, capture_output=True, text=True, check=True)
    assert ("install -qqy --no-install-recommends chromium" in said.read_text()) == installs
    assert ("CHROMIUM=/usr/bin/" in done.stdout) == (not installs)
