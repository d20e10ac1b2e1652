"""An import changes nothing: it starts no thread, opens no file, reads no shapes and registers nothing."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = {
    "linked_fleet_agent": ROOT / "agents/linked_fleet_agent",
    "linked_fleet_gateway": ROOT / "gateway/linked_fleet_gateway",
    "linked_fleet_doctor": ROOT / "gateway/linked_fleet_doctor",
    "linked_fleet_server": ROOT / "gateway/linked_fleet_server",
    "linked_fleet_shacl": ROOT / "gateway/linked_fleet_shacl",
    "linked_fleet_valkey": ROOT / "gateway/linked_fleet_valkey",
    "linked_fleet_webhooks": ROOT / "gateway/linked_fleet_webhooks",
    **{
        f"linked_fleet_{each}": ROOT / f"gateway/linked_fleet_{each}"
        for each in ("base", "identity", "link", "rdf", "runtime", "state")
    },
    "linked_fleet_client": ROOT / "client/linked_fleet_client",
}
_PROGRAM = """
import importlib, json, os, sys, threading
before = set(os.listdir("/proc/self/fd"))
read = []
def note(event, arguments):
    if event == "open" and str(arguments[0]).endswith(".ttl"):
        read.append(str(arguments[0]))
sys.addaudithook(note)
for name in sys.argv[1:]:
    importlib.import_module(name)
from linked_fleet_base import contributions
print(json.dumps({
    "threads": [each.name for each in threading.enumerate()][1:],
    "files": sorted(os.readlink(f"/proc/self/fd/{each}") for each in set(os.listdir("/proc/self/fd")) - before
                    if os.path.exists(f"/proc/self/fd/{each}")),
    "shapes": sorted(set(read)),
    "contributions": [] if contributions.present()._derived == {} and contributions.present().robot_properties == () and
                     contributions.present().at_root == contributions.CORE_AT_ROOT else ["some"],
}))
"""


def _modules(package: str) -> list[str]:
    root = PACKAGES[package]
    files = [path for path in root.rglob("*.py") if not {"tests", "node_modules"} & set(path.parts)]
    names = [".".join((package, *path.relative_to(root).with_suffix("").parts)) for path in files]
    skipped = ("__main__", "conftest")
    return sorted(name.removesuffix(".__init__") for name in names if name.rpartition(".")[2] not in skipped)


@pytest.mark.parametrize("package", PACKAGES)
def test_an_import_changes_nothing(package: str) -> None:
    modules = _modules(package)
    assert len(modules) >= 3
    done = subprocess.run(
        [sys.executable, "-c", _PROGRAM, *modules], capture_output=True, text=True, check=False, cwd=ROOT
    )
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(done.stdout.splitlines()[-1])
    assert {kind: what for kind, what in found.items() if what} == {}


_HEAVY = ("asyncio", "starlette", "zenoh", "redis", "httpx", "websockets", "prometheus_client")
_CORE = ("api", "serving", "app", "http", "actions", "subscriptions", "link", "server", "runtime")


@pytest.mark.parametrize(
    "module", ["query.worker", "components.part", "reach.can_reach", "world.check_process", "world.worker"]
)
def test_worker_processes_load_neither_http_nor_zenoh(module: str) -> None:
    name = f"linked_fleet_gateway.extensions.{module}"
    done = subprocess.run(
        [sys.executable, "-c", f"import {name}, sys; print(*sys.modules)"],
        capture_output=True, text=True, check=True, cwd=ROOT,
    )  # fmt: skip
    loaded = set(done.stdout.split())
    assert name in loaded
    assert loaded.isdisjoint([*_HEAVY, *(f"linked_fleet_gateway.{each}" for each in _CORE)])
