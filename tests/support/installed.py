"""Wheels of a tree of this project, installed beside the dependencies of the tests and run outside the checkout."""

import contextlib
import os
import subprocess
import sys
import sysconfig
from collections.abc import Iterator
from pathlib import Path

from running import ROOT

_PINS = str(ROOT / "deploy/constraints.txt")


def build_wheels(folder: Path, tree: Path, *flags: str) -> list[Path]:
    """Build the wheels of gateway and agent into ``folder``, and return them in this order."""
    _pip("wheel", "--no-deps", *flags, "-w", str(folder), str(tree / "agents"), str(tree))
    return sorted(folder.glob("*.whl"))


def environment(folder: Path, wheels: list[Path], *others: str) -> Path:
    """Create an environment with these wheels and ``others``. It borrows their dependencies. Return its programs."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True)
    site = next(folder.glob("lib/python*/site-packages"))
    _pip("--python", str(folder / "bin" / "python"), "install", "--no-deps", *others, *map(str, wheels))
    # Lines of a .pth file add folders, whose own .pth files are ignored: the checkout is not on the path.
    lent = Path(sysconfig.get_path("purelib"))
    (site / "cmeel.prefix").symlink_to(lent / "cmeel.prefix")
    (site / "lent.pth").write_text(f"{lent}\nimport cmeel_pth\n")
    return folder / "bin"


def _pip(*arguments: str) -> None:
    variables = {**os.environ, "PIP_CONSTRAINT": _PINS, "PIP_BUILD_CONSTRAINT": _PINS}
    subprocess.run([sys.executable, "-m", "pip", "-q", *arguments], check=True, env=variables, cwd="/")


@contextlib.contextmanager
def running(programs: Path, program: str, *arguments: str, cwd: Path) -> Iterator[None]:
    """Run a program of an environment. What it logs is in ``cwd``."""
    variables = {**os.environ, "XDG_STATE_HOME": str(cwd / "state")}
    variables.pop("PYTHONPATH", None)
    with (cwd / f"{program}.log").open("w") as log:
        child = subprocess.Popen(
            [str(programs / program), *arguments], cwd=cwd, env=variables, stdout=log, stderr=subprocess.STDOUT
        )
    try:
        yield
    finally:
        child.terminate()
        child.wait(30)
