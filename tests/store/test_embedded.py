"""The embedded server: one per state folder, independent of the gateways that use it, with persistent data."""

import asyncio
import logging
import os
import platform
import re
import shutil
import signal
import subprocess
import tempfile
import textwrap
import time
from collections.abc import Callable
from pathlib import Path
from urllib.parse import unquote

import pytest
import redis
from redis.backoff import NoBackoff
from redis.retry import Retry

from linked_fleet_gateway.subscriptions.store import SubscriptionStore
from linked_fleet_valkey import server as embedded
from linked_fleet_valkey.server import EmbeddedRedis
from running import PATIENCE_S, process

pytestmark = [pytest.mark.processes, pytest.mark.usefixtures("patient")]
GATEWAY = textwrap.dedent("""
    import asyncio, sys
    from pathlib import Path
    from linked_fleet_valkey.server import EmbeddedRedis

    async def main():
        async with EmbeddedRedis(Path(sys.argv[1])):
            print("open", flush=True)
            await asyncio.Event().wait()

    asyncio.run(main())
""")


def client(server: EmbeddedRedis) -> redis.Redis:
    path = unquote(server.url.removeprefix("unix://"))
    return redis.Redis(unix_socket_path=path, socket_timeout=PATIENCE_S, retry=Retry(NoBackoff(), 0))


def write(server: EmbeddedRedis, value: str) -> None:
    with client(server) as connection:
        connection.set("value", value)


def read(server: EmbeddedRedis) -> str:
    with client(server) as connection:
        return connection.get("value").decode()


def pid(server: EmbeddedRedis) -> int:
    """Return the process that answers; 0 if none does."""
    try:
        with client(server) as connection:
            return int(connection.info()["process_id"])
    except redis.ConnectionError:
        return 0


def alive(number: int) -> bool:
    try:
        return "\nState:\tZ" not in Path(f"/proc/{number}/status").read_text()
    except OSError:
        return False


async def until(probe: Callable[[], object], what: str) -> None:
    started = time.monotonic()
    while not probe():
        assert time.monotonic() - started < PATIENCE_S, f"never happened: {what}"
        await asyncio.sleep(0.01)


@pytest.fixture
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Search for another server at once or not at all: its end is no failure in this test."""
    monkeypatch.setattr(embedded, "_PAUSES_S", (embedded._PAUSES_S[0], 3600.0))


async def test_the_embedded_server_keeps_its_data(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    state_dir = tmp_path / "a folder" / "of ours #1"
    with caplog.at_level(logging.WARNING):
        async with EmbeddedRedis(state_dir) as server, SubscriptionStore(server.url, "fleet", "a") as store:
            await store.renew_lease()
            write(server, "kept")
            number = pid(server)
            assert os.getsid(number) != os.getsid(0), "Ctrl-C would end it before us"
        assert not alive(number)
        async with EmbeddedRedis(state_dir) as server:
            assert read(server) == "kept"
    assert caplog.records == []
    assert state_dir.stat().st_mode & 0o777 == 0o700
    assert all(path.stat().st_mode & 0o077 == 0 for path in state_dir.rglob("*"))


async def test_gateways_that_start_together_share_one_server(tmp_path: Path) -> None:
    async with asyncio.TaskGroup() as group:
        servers = [EmbeddedRedis(tmp_path) for _ in range(8)]
        for server in servers:
            group.create_task(server.__aenter__())
    assert len({pid(server) for server in servers}) == 1
    for server in servers:
        await server.__aexit__()


@pytest.mark.usefixtures("at_once")
async def test_when_the_gateway_that_started_it_ends_another_starts_it_again(tmp_path: Path) -> None:
    async with EmbeddedRedis(tmp_path) as first, EmbeddedRedis(tmp_path) as second:
        write(first, "kept")
        number = pid(second)
        await first.__aexit__()
        assert not alive(number)
        await until(lambda: pid(second), "the second's own server")
        assert pid(second) != number
        assert read(second) == "kept"
        await first.__aenter__()
        assert pid(first) == pid(second)


async def test_a_server_goes_with_a_gateway_that_is_killed_and_is_replaced(tmp_path: Path) -> None:
    with process("-c", GATEWAY, str(tmp_path)) as gateway:
        gateway.said("open")
        async with EmbeddedRedis(tmp_path) as server:
            write(server, "kept")
            number = pid(server)
            gateway.send(signal.SIGKILL)
            await until(lambda: pid(server) not in (0, number), "another server")
            assert not alive(number)
            assert read(server) == "kept"


def test_an_orphan_is_found_and_used_and_left_to_itself(tmp_path: Path) -> None:
    server = EmbeddedRedis(tmp_path)
    orphan = subprocess.Popen([embedded._program(), *embedded._configuration(tmp_path, tmp_path / "valkey.sock")])

    async def run() -> None:
        await until(lambda: pid(server), "the orphan answers")
        async with server:
            assert pid(server) == orphan.pid
        assert pid(server) == orphan.pid
        async with server:
            write(server, "kept")
            orphan.terminate()
            await until(lambda: orphan.poll() is not None and pid(server), "our own server")
            assert read(server) == "kept"

    try:
        asyncio.run(run())
    finally:
        orphan.kill()
        orphan.wait()


@pytest.mark.usefixtures("at_once")
async def test_a_killed_server_is_replaced_with_nothing_lost_and_few_words(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO, logger=embedded.__name__):
        async with EmbeddedRedis(tmp_path) as server:
            for round_ in range(3):
                async with embedded._locked(tmp_path / "lock", "it is still being started"):
                    number = pid(server)
                    write(server, str(round_))
                    os.kill(number, signal.SIGKILL)
                await until(lambda number=number: pid(server) not in (0, number), "another server")
                assert read(server) == str(round_)
    assert 4 <= len(caplog.records) <= 8


async def test_a_deep_folder_has_its_socket_elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runtime = Path(tempfile.mkdtemp(dir="/tmp"))  # pytest's own folders may be too long for a socket
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(runtime))
    deep = tmp_path / ("d" * 60) / ("e" * 60)
    try:
        async with EmbeddedRedis(deep) as server, EmbeddedRedis(deep) as other:
            assert server.url.startswith(f"unix://{runtime}/linked-fleet-")
            assert pid(server) == pid(other) != 0
            assert EmbeddedRedis(deep / "f").url != server.url
    finally:
        shutil.rmtree(runtime)


async def test_a_stale_socket_is_no_obstacle(tmp_path: Path) -> None:
    (tmp_path / "valkey.sock").touch()
    async with EmbeddedRedis(tmp_path) as server:
        assert pid(server)


def open_without_server(state_dir: Path, caplog: pytest.LogCaptureFixture) -> str:
    """Return the log of a server that cannot be started; the gateway's side opens nevertheless."""

    async def run() -> None:
        async with EmbeddedRedis(state_dir) as server:
            assert pid(server) == 0

    with caplog.at_level(logging.ERROR, logger=embedded.__name__):
        asyncio.run(run())
    (record,) = caplog.records
    return record.getMessage()


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "file").touch()
    said = open_without_server(tmp_path / "file" / "state", caplog)
    assert re.search(r": cannot keep data in .*/file/state: Not a directory; .* --state-dir$", said), said


def test_a_machine_without_a_binary_is_told_to_set_redis_url(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(platform, "machine", lambda: "riscv64")
    said = open_without_server(tmp_path, caplog)
    assert re.search(r": no embedded server for this machine, set REDIS_URL instead: .*riscv64", said), said


def test_a_binary_that_cannot_run_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(embedded, "_program", lambda: str(tmp_path / "absent"))
    said = open_without_server(tmp_path, caplog)
    assert re.search(r": cannot run .*/absent: No such file or directory; set REDIS_URL instead$", said), said


async def test_a_server_that_could_not_be_started_is_started_as_soon_as_it_can_be(tmp_path: Path) -> None:
    obstacle = tmp_path / "file"
    obstacle.touch()
    async with EmbeddedRedis(obstacle / "state") as server:
        assert pid(server) == 0
        obstacle.unlink()
        await until(lambda: pid(server), "a server")
