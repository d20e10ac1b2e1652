"""A trial of a mutant: a forked process imports the changed module and runs the tests.

No module of this project is imported before the fork, so code that runs on import is mutated as well. Foreign modules
are imported once, before it.
"""

import contextlib
import importlib
import json
import os
import resource
import signal
import sys
from collections.abc import Mapping, Sequence
from enum import StrEnum
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import spec_from_file_location
from math import ceil
from pathlib import Path
from types import CodeType
from typing import Any, NoReturn

import hypothesis
import pytest

from mutation.modules import module_name
from mutation.mutants import Mutant

_MOST_MEMORY = 4 * 1024**3
_WAIT = 4  # factor on the processor seconds of a trial: for tests that wait, on a busy machine
_OPTIONS = ("-x", "-q", "--assert=plain", "--hypothesis-profile=mutants", "-p", "no:cacheprovider", "-p", "no:xdist",
            "-p", "no:rerunfailures")  # fmt: skip
# The same examples in every run; one failing example suffices, and shrinking it would take long. An example may be
# slow, since a failure for that would count as a killed mutant.
hypothesis.settings.register_profile(
    "mutants",
    derandomize=True,
    deadline=None,
    suppress_health_check=(hypothesis.HealthCheck.too_slow,),
    phases=(hypothesis.Phase.explicit, hypothesis.Phase.generate),
)


class Outcome(StrEnum):
    KILLED = "killed"
    TIMEOUT = "timeout"
    SURVIVED = "survived"


class _Loader(SourceFileLoader):
    def __init__(self, mutant: Mutant) -> None:
        super().__init__(mutant.name, str(mutant.path))
        self._mutant = mutant

    def get_code(self, fullname: str) -> CodeType:
        return compile(self._mutant.source, self._mutant.path, "exec")


class _Finder(MetaPathFinder):
    def __init__(self, mutant: Mutant) -> None:
        self._mutant = mutant

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> ModuleSpec | None:
        if fullname != self._mutant.name:
            return None
        return spec_from_file_location(fullname, self._mutant.path, loader=_Loader(self._mutant))


class Trials:
    """Trials with the ``tests`` of a target; ``slow`` ones run only for mutants that the others do not kill."""

    def __init__(self, root: Path, target: Mapping[str, Sequence[str]]) -> None:
        """Raises RuntimeError if the tests fail without a mutant, or pass although a module cannot be imported."""
        slow = target.get("slow", ())
        rounds = [[*target["tests"], *(f"--deselect={test}" for test in slow)], list(slow)]
        for tests in filter(None, rounds):
            _import_others(root, tests)
        self._rounds = [(tests, ceil(3 * _seconds(tests)) + 2) for tests in rounds if tests]
        for file in target["modules"]:
            broken = Mutant(module_name(file), root / file, "raise ImportError", (file, "", ""))
            if self.outcome(broken) is not Outcome.KILLED:
                raise RuntimeError(f"the tests do not import {broken.name}")

    def outcome(self, mutant: Mutant) -> Outcome:
        for tests, limit_s in self._rounds:
            _, status, _ = os.wait4(os.fork() or _run(tests, limit_s, mutant), 0)
            if os.WIFSIGNALED(status) and os.WTERMSIG(status) in (signal.SIGXCPU, signal.SIGALRM, signal.SIGKILL):
                return Outcome.TIMEOUT
            if status != 0:
                return Outcome.KILLED
        return Outcome.SURVIVED


def _import_others(root: Path, tests: Sequence[str]) -> None:
    """Import the tests' imports, except modules of this project."""
    answer, writer = os.pipe()
    if not (pid := os.fork()):
        _run(tests, 600, told=lambda: os.write(writer, json.dumps(_others(root)).encode()))
    os.close(writer)
    with os.fdopen(answer) as file:
        modules = json.load(file)
    os.waitpid(pid, 0)
    for name in modules:
        with contextlib.suppress(ImportError):
            importlib.import_module(name)


def _seconds(tests: Sequence[str]) -> float:
    """Return the processor seconds of the tests without a mutant."""
    _, status, used = os.wait4(os.fork() or _run(tests, 600), 0)
    if status:
        raise RuntimeError(f"the tests fail without a mutant: pytest {' '.join(tests)}")
    return used.ru_utime + used.ru_stime


def _run(tests: Sequence[str], limit_s: int, mutant: Mutant | None = None, told: Any = None) -> NoReturn:
    code: int = pytest.ExitCode.INTERNAL_ERROR
    try:
        resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s + 1))
        resource.setrlimit(resource.RLIMIT_AS, (_MOST_MEMORY, _MOST_MEMORY))
        signal.alarm(limit_s * _WAIT)
        if mutant is not None:
            sys.meta_path.insert(0, _Finder(mutant))
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        code = pytest.main([*_OPTIONS, *tests])
        if told is not None:
            told()
    finally:
        os._exit(code)


def _others(root: Path) -> list[str]:
    """Return the imported modules that are not of this project, in the order of their import."""
    own = tuple(f"{folder}/" for folder in root.iterdir() if not folder.name.startswith("."))
    files = {name: getattr(module, "__file__", None) for name, module in list(sys.modules.items())}
    return [name for name, file in files.items() if file and not file.startswith(own)]
