"""Makefile: programs that make installs."""

import shutil
import subprocess
from pathlib import Path

import pytest

from running import ROOT

_PROGRAMS = ("sh", "id", "grep", "date")


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
