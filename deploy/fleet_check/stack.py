"""The compose project under test: started, damaged and taken down with docker or podman."""

import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

PROJECT = "linked-fleet-check"
_FILES = ("docker-compose.yml", "deploy/fleet_check/compose.yaml")
_START_S = 1800.0  # images are built the first time
_COMMAND_S = 120.0


class StackError(Exception):
    """A command of the container engine failed; the message is its output."""


class Stack:
    """A compose project: the words of the command ``compose``, and environment variables for the compose files."""

    def __init__(self, compose: Sequence[str], environment: Mapping[str, str]) -> None:
        self._program = tuple(compose)
        self._engine = "docker" if any(Path(word).name.startswith("docker") for word in compose) else "podman"
        self._environment, self._files = {**os.environ, **environment}, list(_FILES)

    def add(self, files: Sequence[str], environment: Mapping[str, str]) -> None:
        """Add compose files, and variables for them, to the commands from now on."""
        self._files += files
        self._environment |= environment

    @property
    def _compose(self) -> tuple[str, ...]:
        """The compose command of this project."""
        return (*self._program, *(word for file in self._files for word in ("-f", file)), "-p", PROJECT)

    def build(self) -> None:
        """Build each image once, through one of its services: podman-compose would build it once per service."""
        self._run(*self._compose, "build", "gateway", "baxter", timeout_s=_START_S, shown=True)

    def up(self) -> None:
        self._run(*self._compose, "up", "-d", timeout_s=_START_S)

    def down(self, volumes: bool = True) -> None:
        """Remove the containers, and by default everything that they have stored."""
        words = ("-v",) if volumes else ()
        self._run(*self._compose, "down", *words, "-t", "5", "--remove-orphans", timeout_s=_COMMAND_S)

    def volumes(self) -> list[str]:
        """Return the names of the project's volumes."""
        return self._run(self._engine, "volume", "ls", "-q", "--filter", f"name={PROJECT}_").split()

    def backup(self, action: str, folder: Path) -> None:
        """Save the fleet in a folder or restore it, as operators do."""
        words = ("deploy/backup.py", action, str(folder), "--compose", shlex.join(self._compose))
        self._run(sys.executable, *words)

    def scale(self, service: str, replicas: int) -> None:
        words = ("up", "-d", "--no-deps", "--no-recreate", "--scale", f"{service}={replicas}", service)
        self._run(*self._compose, *words)

    def read(self, service: str, path: str) -> str:
        """Return a file of a service's container."""
        return self._run(self._engine, "exec", self.containers(service)[0], "cat", path)

    def execute(self, container: str, *words: str) -> str:
        return self._run(self._engine, "exec", container, *words)

    def containers(self, service: str) -> list[str]:
        """Return the ids of a service's running containers."""
        labels = (f"com.docker.compose.project={PROJECT}", f"com.docker.compose.service={service}")
        filters = [word for label in labels for word in ("--filter", f"label={label}")]
        return self._run(self._engine, "ps", "-q", "--no-trunc", *filters).split()

    def kill(self, container: str) -> None:
        """Kill a container without a regular shutdown."""
        self._run(self._engine, "kill", "--signal", "KILL", container)

    def start(self, container: str) -> None:
        self._run(self._engine, "start", container)

    def stop(self, container: str) -> None:
        self._run(self._engine, "stop", container)

    def restart(self, service: str) -> None:
        for container in self.containers(service):
            self._run(self._engine, "restart", container)

    def logs(self, service: str, lines: int = 15) -> str:
        return "".join(
            self._run(self._engine, "logs", "--tail", str(lines), container, merged=True)
            for container in self.containers(service)
        )

    def _run(self, *words: str, timeout_s: float = _COMMAND_S, shown: bool = False, merged: bool = False) -> str:
        try:
            done = subprocess.run(  # noqa: S603 (the user's own engine, no shell)
                words,
                env=self._environment,
                stdout=sys.stderr if shown else subprocess.PIPE,
                stderr=None if shown else subprocess.STDOUT if merged else subprocess.PIPE,
                text=True,
                errors="replace",
                timeout=timeout_s,
                check=False,
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise StackError(f"{shlex.join(words)}: {error}") from error
        if done.returncode:
            said = (done.stderr or done.stdout or "").strip()[-1500:]
            raise StackError(f"{shlex.join(words)} ended with exit code {done.returncode}: {said}")
        return done.stdout or ""


def compose_command(command: str) -> list[str]:
    """Return the words of ``command``, else docker compose or podman-compose. StackError if neither exists."""
    if command:
        return shlex.split(command)
    if shutil.which("docker") and _works("docker", "compose", "version") and _works("docker", "info"):
        return ["docker", "compose"]
    if shutil.which("podman-compose"):
        return ["podman-compose"]
    raise StackError("neither docker compose nor podman-compose works here; name another: make fleet-check COMPOSE=...")


def _works(*words: str) -> bool:
    return subprocess.run(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False).returncode == 0  # noqa: S603
