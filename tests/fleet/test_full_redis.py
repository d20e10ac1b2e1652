"""A Redis server without room in memory or on its disk, as the counterpart of tests on virtual time."""

import contextlib
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from commanding import problem
from gateway_group import arrived, deliveries, gateway, hub
from receivers import receiving
from redis_servers import Server
from running import eventually
from subscribers import Socket
from tests.fleet.test_fault_redis import Scene, refused_and_remembered, scene, unless_away

pytestmark = pytest.mark.processes
__all__ = ["scene"]


def test_a_full_redis_refuses_only_requests_that_need_it(scene: Scene) -> None:
    def configure(node: Server, maxmemory: int) -> None:
        for name, value in (("maxmemory-policy", "noeviction"), ("maxmemory", maxmemory)):
            assert node.ask("CONFIG SET", name, value) == "+OK"

    refused_and_remembered(scene, lambda node: configure(node, 1), lambda node: configure(node, 0), "/full")


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """Yield a file system of its own with little room."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mounted = subprocess.run(("mount", "-t", "tmpfs", "-o", "size=4m", "none", folder), capture_output=True, text=True)
    if mounted.returncode:
        pytest.skip(f"a file system of a test's own cannot be mounted here: {mounted.stderr.strip()}")
    try:
        yield folder
    finally:
        subprocess.run(("umount", "-l", folder), check=True)


def test_a_full_disk_loses_nothing_that_was_accepted(small_disk: Path) -> None:
    """The gateway's embedded server cannot write: callbacks are refused until there is room, and streams continue."""
    with hub() as stage, receiving() as receiver, gateway(stage, state=small_disk) as at:
        at.subscribed(receiver.url("/before"))
        receiver.wait(1)
        filler = small_disk / "filler"
        with filler.open("wb") as file, contextlib.suppress(OSError):
            while True:
                os.write(file.fileno(), bytes(4096))
        with Socket(at.rotation) as watching:
            watching.next()
            # What fits into the rest of a block is accepted, and stays.
            made = [f"/{number}" for number in range(20) if at.subscribe(receiver.url(f"/{number}")).status_code == 201]
            refused = at.subscribe(receiver.url("/refused"))
            assert (problem(refused), refused.headers["retry-after"]) == ((503, "redis-unavailable"), "2")
            for _ in range(10):
                stage.step()
                assert watching.next().angle == stage.angle
        filler.unlink()
        eventually(lambda: unless_away(at.get(at.container)), "the server")
        stage.step()
        for path in ("/before", *made):
            arrived(receiver, path, stage.angle)
            deliveries(receiver.log(path, "POST"))
        eventually(lambda: len(at.listed()) == 1 + len(made), "what was accepted, and nothing else")
        assert receiver.log("/refused") == []
        assert "Traceback" not in at.process.output
