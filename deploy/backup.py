"""Saves and restores what the compose fleet keeps: python3 deploy/backup.py save FOLDER, … restore FOLDER

save copies from the running fleet, without an interruption, into a new folder:

  redis.rdb        a snapshot of Redis at one instant
  front.tar        the front's certificate authority, its certificates and keys
  recordings.tar   recordings of failures and stops
  files.tar        files of this machine: .env, the folders of certificates (LINKED_FLEET_CERTIFICATES) and identities
                   (LINKED_FLEET_IDENTITIES_FOLDER), and those of --file

restore puts them back where there is nothing: into empty volumes, and beside existing files, which it keeps. Run it
before the fleet is started. The folder contains private keys: keep it as safe as they are. Paths are those of the
folder from which both are called, the one of docker-compose.yml. Needs Python 3.11 and tar.
"""

import argparse
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, NamedTuple


class BackupError(Exception):
    """A command failed, or something is in the way. One line for people."""


class Part(NamedTuple):
    """A part of the backup: shell commands in a service's container that write it to stdout, and read it from stdin.

    ``load`` ends with exit code 9, and changes nothing, if something is there already.
    """

    file: str
    service: str
    save: str
    load: str


def _tar(file: str, service: str, folder: str, name: str) -> Part:
    """Return a part that is the folder ``name`` in ``folder``, which may be missing when it is saved."""
    save = f"cd {folder} && mkdir -p {name} && exec tar --exclude='*.new' -cf - {name}"
    return Part(file, service, save, f"cd {folder} && {{ [ ! -e {name} ] || exit 9; }} && exec tar -xf -")


# Redis loads a snapshot as the base of its append-only file. It is written to a file first, because on stdout
# redis-cli appends the mark by which it finds the end.
_SNAPSHOT = (
    """umask 077; cd /data && redis-cli --rdb backup.rdb >&2 && cat backup.rdb; code=$?; rm -f backup.rdb; exit $code"""
)
_LOAD_SNAPSHOT = """
umask 077; cd /data && { [ ! -e appendonlydir ] || exit 9; } && mkdir appendonlydir && cd appendonlydir &&
  cat > appendonly.aof.1.base.rdb && echo 'file appendonly.aof.1.base.rdb seq 1 type b' > appendonly.aof.manifest
"""

PARTS = (
    Part("redis.rdb", "redis", _SNAPSHOT, _LOAD_SNAPSHOT),
    _tar("front.tar", "front", "/data", "caddy"),
    _tar("recordings.tar", "gateway", "/var/lib/linked-fleet", "recordings"),
)
FILES = "files.tar"
_MOUNTED = {"LINKED_FLEET_CERTIFICATES": "certificates", "LINKED_FLEET_IDENTITIES_FOLDER": ""}
"""Variables of compose files that name folders of this machine, with their defaults."""
_OCCUPIED = 9
Stream = IO[bytes] | None


@dataclass(frozen=True)
class Compose:
    """The command of the compose fleet."""

    words: tuple[str, ...]

    def save(self, part: Part, path: Path) -> None:
        with path.open("wb") as target:
            self._run("exec", "-T", part.service, "sh", "-c", part.save, stdout=target)

    def load(self, part: Part, path: Path) -> None:
        """Run the command in a container of its own, because the service may not run yet."""
        options = ("--rm", "-T", "--no-deps", "--entrypoint", "sh")
        with path.open("rb") as source:
            code = self._run("run", *options, part.service, "-c", part.load, stdin=source, allowed=_OCCUPIED)
        if code == _OCCUPIED:
            raise BackupError(f"{part.service} has data already; take the fleet down with -v, which deletes them")

    def _run(self, *words: str, stdin: Stream = None, stdout: Stream = None, allowed: int = 0) -> int:
        return _run((*self.words, *words), f"{self.words[0]} … {words[0]}", stdin, stdout, allowed)


def save(compose: Compose, folder: Path, files: Sequence[Path]) -> None:
    """Save everything in ``folder``, which exists only if that is complete. Raises BackupError."""
    if folder.exists():
        raise BackupError(f"{folder} exists; name a new folder")
    unfinished = folder.with_name(f"{folder.name}.unfinished")
    shutil.rmtree(unfinished, ignore_errors=True)
    os.umask(0o077)
    unfinished.mkdir(parents=True)
    for part in PARTS:
        compose.save(part, unfinished / part.file)
    _run_tar("-cf", unfinished / FILES, *map(str, files))
    unfinished.rename(folder)
    for path in sorted(folder.iterdir()):
        print(f"{path}: {path.stat().st_size} bytes")
    print(f"files of this machine: {', '.join(map(str, files)) or 'none'}")


def restore(compose: Compose, folder: Path) -> None:
    """Restore files of this machine first, because services mount them. Raises BackupError."""
    missing = [name for name in (*(part.file for part in PARTS), FILES) if not (folder / name).is_file()]
    if missing:
        raise BackupError(f"{folder} is no backup: {', '.join(missing)} is missing")
    _run_tar("--skip-old-files", "-xpf", folder / FILES)
    for part in PARTS:
        compose.load(part, folder / part.file)
        print(f"{folder / part.file}: restored")


def own_files(environment: Mapping[str, str], more: Sequence[Path]) -> list[Path]:
    """Return the files to save: those that compose uses, if they exist, and ``more``. Raises BackupError."""
    missing = [str(path) for path in more if not path.exists()]
    if missing:
        raise BackupError(f"{', '.join(missing)}: no such file")
    names = [environment.get(variable, usual) for variable, usual in _MOUNTED.items()]
    return [path for path in map(Path, [".env", *filter(None, names)]) if path.exists()] + list(more)


def _run_tar(action: str, *words: object) -> None:
    # With -P absolute names stay absolute; without files the archive is empty (-T).
    _run(("tar", "-P", "--numeric-owner", "-T", "/dev/null", action, *map(str, words)), "tar")


def _run(command: Sequence[str], name: str, stdin: Stream = None, stdout: Stream = None, allowed: int = 0) -> int:
    """Return the exit code, 0 or ``allowed``."""
    try:
        done = subprocess.run(command, stdin=stdin or subprocess.DEVNULL, stdout=stdout or sys.stderr, check=False)  # noqa: S603
    except OSError as error:
        raise BackupError(f"{command[0]} cannot be run: {error.strerror}") from error
    if done.returncode not in (0, allowed):
        raise BackupError(f"{name} ended with exit code {done.returncode}")
    return done.returncode


def main() -> int:
    """Return exit code 1, after printing one line, if something is not saved or restored."""
    parser = argparse.ArgumentParser(
        prog="python3 deploy/backup.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("action", choices=("save", "restore"))
    parser.add_argument("folder", type=Path)
    usual = "docker compose"
    parser.add_argument("--compose", default=usual, help=f"the command, with its options (default: {usual})")
    parser.add_argument("--file", type=Path, action="append", default=[], help="another file or folder to save")
    arguments = parser.parse_args()
    compose = Compose(tuple(shlex.split(arguments.compose)))
    try:
        if arguments.action == "save":
            save(compose, arguments.folder, own_files(os.environ, arguments.file))
        else:
            restore(compose, arguments.folder)
    except (BackupError, OSError) as error:
        print(f"backup: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
