"""The script that saves and restores the compose fleet; make fleet-check runs it with containers."""

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "deploy" / "backup.py"
# A stand-in for compose: each service is a folder, in which the script of the container runs with its paths below it.
COMPOSE = """#!/bin/sh
action=$1; while [ "$1" != redis ] && [ "$1" != front ] && [ "$1" != gateway ]; do shift; done
service=$1; for script; do :; done
echo "$action $service" >> "$LOG"
[ "$service" != "$BROKEN" ] || exit 3
root=$PWD/$service; mkdir -p "$root/data" "$root/var/lib/linked-fleet"
[ "$service" = redis ] && PATH="$PWD/bin:$PATH"
exec sh -c "$(printf %s "$script" | sed "s#cd /#cd $root/#")"
"""
REDIS_CLI = '#!/bin/sh\necho "progress"\ncp live.rdb "$2"\n'


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of a fleet with some state and files."""
    monkeypatch.chdir(tmp_path)
    for name, text in (("compose", COMPOSE), ("bin/redis-cli", REDIS_CLI)):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
        path.chmod(0o755)
    for name, text in STATE.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


STATE = {
    "redis/data/live.rdb": "REDIS",
    "front/data/caddy/root.key": "key",
    "gateway/var/lib/linked-fleet/recordings/r/1.mcap": "mcap",
    "gateway/var/lib/linked-fleet/recordings/r/2-x.new": "unfinished",
    "certificates/ca.key": "ca",
    ".env": "LINKED_FLEET_DOMAIN=fleet.example",
    "roster/identities.toml": "[[token]]",
    "extra.json": "{}",
}


def run(place: Path, *words: str, **environment: str) -> "subprocess.CompletedProcess[str]":
    variables: Mapping[str, str] = {"LOG": str(place / "log"), "BROKEN": "", "LINKED_FLEET_IDENTITIES_FOLDER": "roster"}
    return subprocess.run(
        [sys.executable, str(SCRIPT), *words, "--compose", "./compose"],
        env={**os.environ, **variables, **environment}, capture_output=True, text=True, check=False,
    )  # fmt: skip


def save(place: Path) -> None:
    done = run(place, "save", "kept", "--file", "extra.json")
    assert done.returncode == 0, done.stderr


def lose(place: Path, *keep: str) -> None:
    for name in STATE.keys() - set(keep):
        (place / name).unlink()
    (place / "gateway/var/lib/linked-fleet/recordings/r").rmdir()
    (place / "gateway/var/lib/linked-fleet/recordings").rmdir()
    (place / "front/data/caddy").rmdir()


def test_what_was_saved_is_restored(place: Path) -> None:
    save(place)
    assert not (place / "redis/data/backup.rdb").exists(), "nothing is left in the volume"
    lose(place)
    done = run(place, "restore", "kept")
    assert done.returncode == 0, done.stderr
    files = [name for name in STATE if "redis" not in name and not name.endswith(".new")]
    assert {name: (place / name).read_text() for name in files} == {name: STATE[name] for name in files}
    append_only = place / "redis/data/appendonlydir"
    assert (append_only / "appendonly.aof.1.base.rdb").read_text() == "REDIS"
    assert (append_only / "appendonly.aof.manifest").read_text() == "file appendonly.aof.1.base.rdb seq 1 type b\n"
    assert not (place / "gateway/var/lib/linked-fleet/recordings/r/2-x.new").exists()


def test_others_cannot_read_what_is_saved(place: Path) -> None:
    save(place)
    kept = [place / "kept", *(place / "kept").iterdir()]
    assert [oct(path.stat().st_mode & 0o077) for path in kept] == ["0o0"] * len(kept)
    assert len(kept) == 5


@pytest.mark.parametrize("broken", ["redis", "front", "gateway"])
def test_a_backup_that_is_not_complete_has_another_name(place: Path, broken: str) -> None:
    done = run(place, "save", "kept", BROKEN=broken)
    assert (done.returncode, done.stderr.splitlines()[-1]) == (1, "backup: ./compose … exec ended with exit code 3")
    assert not (place / "kept").exists()
    save(place)


def test_a_backup_replaces_no_other(place: Path) -> None:
    save(place)
    done = run(place, "save", "kept")
    assert (done.returncode, done.stderr) == (1, "backup: kept exists; name a new folder\n")


@pytest.mark.parametrize(
    ("service", "name"),
    [
        ("redis", "redis/data/appendonlydir/appendonly.aof.manifest"),
        ("front", "front/data/caddy/root.key"),
        ("gateway", "gateway/var/lib/linked-fleet/recordings/r/1.mcap"),
    ],
)
def test_a_volume_with_data_is_not_overwritten(place: Path, service: str, name: str) -> None:
    save(place)
    lose(place)
    (place / name).parent.mkdir(parents=True, exist_ok=True)
    (place / name).write_text("of somebody")
    done = run(place, "restore", "kept")
    assert done.returncode == 1 and f"{service} has data already" in done.stderr
    assert (place / name).read_text() == "of somebody"


def test_a_file_of_this_machine_is_not_overwritten(place: Path) -> None:
    save(place)
    lose(place)
    (place / ".env").write_text("newer")
    assert run(place, "restore", "kept").returncode == 0
    assert (place / ".env").read_text() == "newer"


@pytest.mark.parametrize("missing", ["redis.rdb", "front.tar", "recordings.tar", "files.tar"])
def test_a_folder_without_a_part_is_refused_before_anything_is_restored(place: Path, missing: str) -> None:
    save(place)
    lose(place)
    (place / "kept" / missing).unlink()
    done = run(place, "restore", "kept")
    assert (done.returncode, done.stderr) == (1, f"backup: kept is no backup: {missing} is missing\n")
    assert not (place / ".env").exists()


def test_a_file_that_is_not_there_is_named(place: Path) -> None:
    done = run(place, "save", "kept", "--file", "absent")
    assert (done.returncode, done.stderr) == (1, "backup: absent: no such file\n")


def test_a_compose_command_that_is_not_there_is_named(place: Path) -> None:
    (place / "compose").unlink()
    done = run(place, "save", "kept")
    assert done.returncode == 1 and done.stderr.startswith("backup: ./compose cannot be run: No such file")
