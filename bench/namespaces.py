"""Network namespaces with links between them: several sites on one machine, whose links can be cut and counted.

It needs root and ``ip`` (iproute2). Everything created belongs to namespaces whose names begin with ``_PREFIX``, and is
removed with them.
"""

import contextlib
import json
import os
import shutil
import signal
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from bench.table import UnavailableError

_PREFIX = "lf-bench-"
_MADE_BY = "LINKED_FLEET_BENCH_NAMESPACES"
"""Variable with the process that removes the namespaces, for those that it starts inside of one."""


def full_name(site: str) -> str:
    """Return the name of a site's namespace, which is unique to this run."""
    return f"{_PREFIX}{_owner()}-{site}"


def _owner() -> str:
    return os.environ.get(_MADE_BY, str(os.getpid()))


@contextlib.contextmanager
def namespaces() -> Iterator[dict[str, str]]:
    """Yield the environment for processes that create namespaces, and remove all namespaces at the end.

    The processes in them end as well. UnavailableError if no namespace can be created. Leftovers of a killed run are
    removed as well.
    """
    if shutil.which("ip") is None:
        raise UnavailableError("network namespaces need the command ip: apt install iproute2")
    for name in _existing():
        owner = name.removeprefix(_PREFIX).partition("-")[0]
        if not Path("/proc", owner).exists():
            _remove(name)
    try:
        add("hub")
    except subprocess.CalledProcessError as error:
        raise UnavailableError(f"no network namespace can be made here: {error.stderr.strip()}") from error
    try:
        yield {**os.environ, _MADE_BY: _owner()}
    finally:
        for name in _existing():
            if name.startswith(full_name("")):
                _remove(name)


def add(site: str) -> None:
    ip("netns", "add", full_name(site))
    ip("-n", full_name(site), "link", "set", "lo", "up")


@dataclass(frozen=True)
class Link:
    """A cable between two sites; the first end is at ``site`` and has the first address."""

    site: str
    device: str
    address: str
    far_address: str

    def cut(self) -> None:
        """Let nothing pass in either direction; connections stay, like with an unplugged cable."""
        ip("-n", full_name(self.site), "link", "set", self.device, "down")

    def heal(self) -> None:
        ip("-n", full_name(self.site), "link", "set", self.device, "up")

    def carried_bytes(self) -> tuple[int, int]:
        """Return the bytes sent and received at the first end since its creation, headers included."""
        said = ip("-n", full_name(self.site), "-s", "-j", "link", "show", self.device)
        (found,) = json.loads(said)
        return found["stats64"]["tx"]["bytes"], found["stats64"]["rx"]["bytes"]


def link(number: int, site: str, far: str) -> Link:
    """Lay link ``number`` (below 64). Its addresses are for documentation (RFC 5737): nothing real is behind them."""
    made = Link(site, f"to-{far}", f"198.51.100.{4 * number + 1}", f"198.51.100.{4 * number + 2}")
    here, there = full_name(site), full_name(far)
    ip("-n", here, "link", "add", made.device, "type", "veth", "peer", "name", f"to-{site}", "netns", there)
    for name, device, address in ((here, made.device, made.address), (there, f"to-{site}", made.far_address)):
        ip("-n", name, "address", "add", f"{address}/30", "dev", device)
        ip("-n", name, "link", "set", device, "up")
    return made


def ip(*words: str) -> str:
    return subprocess.run(("ip", *words), check=True, capture_output=True, text=True).stdout  # noqa: S603, S607


def _existing() -> list[str]:
    return [line.split()[0] for line in ip("netns", "list").splitlines() if line.startswith(_PREFIX)]


def _remove(name: str) -> None:
    for pid in ip("netns", "pids", name).split():
        with contextlib.suppress(ProcessLookupError):
            os.kill(int(pid), signal.SIGKILL)
    ip("netns", "del", name)
