"""The wall clock of a real Redis server jumps back by an hour, like that of the in-memory server on virtual time."""

import shutil
import struct
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from redis_servers import Server
from tests.fleet.test_fault_clock_of_redis import HOUR_S, all_goes_on

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
_SOURCE = Path(__file__).parents[1] / "support" / "shifted_clock.c"


class Clock:
    """The wall clock of a server."""

    def __init__(self, file: Path) -> None:
        self._file = file
        file.write_bytes(bytes(8))

    def jump(self, by_s: int) -> None:
        with self._file.open("r+b") as file:  # in place: the server has mapped it
            file.write(struct.pack("l", by_s))


@pytest.fixture(scope="module")
def shim(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a library that gives a process its own wall clock, which no namespace does."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler, by which a server gets a wall clock of its own")
    library = tmp_path_factory.mktemp("shim") / "clock.so"
    subprocess.run((compiler, "-shared", "-fPIC", "-O1", "-o", library, _SOURCE), check=True)
    return library


@pytest.fixture
def clocked(shim: Path, tmp_path: Path) -> Iterator[tuple[Server, Clock]]:
    file = tmp_path / "ahead"
    clock = Clock(file)
    node = Server(tmp_path / "redis", environment={"LD_PRELOAD": str(shim), "AHEAD": str(file)})
    try:
        node.start()
        yield node, clock
    finally:
        node.discard()


def test_the_clock_of_redis_jumps_back(clocked: tuple[Server, Clock]) -> None:
    node, clock = clocked
    all_goes_on(node, -HOUR_S, clock.jump)
