"""Data that the embedded server cannot load: it starts without it, keeps it, and reports it."""

import asyncio
import logging
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from urllib.parse import unquote

import pytest
import redis
from redis.backoff import NoBackoff
from redis.retry import Retry

from file_damage import DAMAGES, cut_tail, write_data
from linked_fleet_valkey import damaged_data as damage
from linked_fleet_valkey import server as embedded
from linked_fleet_valkey.server import EmbeddedRedis
from running import PATIENCE_S

pytestmark = [pytest.mark.processes, pytest.mark.test_all, pytest.mark.usefixtures("patient")]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    state_dir = tmp_path_factory.mktemp("written")
    write_data(state_dir)
    return state_dir


@pytest.fixture
def state_dir(written: Path, tmp_path: Path) -> Path:
    shutil.copytree(written / damage.DATA, tmp_path / damage.DATA)
    return tmp_path


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def keys(server: EmbeddedRedis) -> int:
    """Return the number of keys; -1 while no server answers."""
    path = unquote(server.url.removeprefix("unix://"))
    try:
        with redis.Redis(unix_socket_path=path, retry=Retry(NoBackoff(), 0)) as client:
            return client.dbsize()
    except redis.ConnectionError:  # also while it loads
        return -1


async def until(probe: Callable[[], object]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not probe():  # noqa: ASYNC110 - a server in another process does not notify
            await asyncio.sleep(0.01)


def started(state_dir: Path) -> tuple[int, tuple[str, ...]]:
    """Return the number of keys of a server with this data, and what was set aside."""

    async def run() -> tuple[int, tuple[str, ...]]:
        async with EmbeddedRedis(state_dir, "subscriptions and idempotency keys") as server:
            return keys(server), server.damaged_copies

    return asyncio.run(run())


@pytest.mark.parametrize("kind", DAMAGES)
def test_damaged_data_are_kept_under_another_name(kind: str, state_dir: Path, caplog: pytest.LogCaptureFixture) -> None:
    """The server starts empty; the log has the reason, the place of the old data, and the lost content."""
    DAMAGES[kind](state_dir / damage.DATA)
    before = content(state_dir / damage.DATA)
    with caplog.at_level(logging.ERROR):
        count, names = started(state_dir)
    assert count == 0
    (name,) = names
    assert content(state_dir / name) == before
    (record,) = caplog.records
    assert record.levelno == logging.ERROR
    for words in (name, str(state_dir), "idempotency keys", "subscriptions", "Reason: "):
        assert words in record.getMessage()


def test_a_tail_that_was_cut_off_is_loaded_without_a_word(state_dir: Path, caplog: pytest.LogCaptureFixture) -> None:
    cut_tail(state_dir / damage.DATA)
    with caplog.at_level(logging.WARNING):
        assert started(state_dir) == (100, ())
    assert caplog.records == []


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_data_that_may_not_be_read_are_set_aside(state_dir: Path) -> None:
    (state_dir / damage.DATA).chmod(0)
    count, names = started(state_dir)
    assert (count, len(names)) == (0, 1)


def test_later_starts_warn_until_the_folder_is_moved_away(state_dir: Path, caplog: pytest.LogCaptureFixture) -> None:
    DAMAGES["an empty manifest"](state_dir / damage.DATA)
    _, (name,) = started(state_dir)
    caplog.clear()
    with caplog.at_level(logging.WARNING):
        assert started(state_dir) == (0, (name,))
    (record,) = caplog.records
    assert record.levelno == logging.WARNING and name in record.getMessage()
    (state_dir / name).rename(state_dir / "looked at")
    assert started(state_dir) == (0, ())


def test_two_damages_in_one_second_are_kept_both(state_dir: Path) -> None:
    data = state_dir / damage.DATA
    first = damage.move_damaged_data(state_dir)
    data.mkdir()
    second = damage.move_damaged_data(state_dir)
    assert first and second and first != second
    assert damage.damaged_copies(state_dir) == (first.name, second.name)


async def test_data_stay_where_no_server_starts_at_all(
    state_dir: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """The machine is at fault, not the data, which is there when it can start servers again."""
    before = content(state_dir / damage.DATA)
    sound = embedded._configuration
    with caplog.at_level(logging.ERROR):
        monkeypatch.setattr(embedded, "_configuration", lambda *paths: [*sound(*paths), "--maxmemory", "nonsense"])
        async with EmbeddedRedis(state_dir) as server:
            assert server.damaged_copies == () and content(state_dir / damage.DATA) == before
            monkeypatch.setattr(embedded, "_configuration", sound)
            await until(lambda: keys(server) == 100)
    (record,) = caplog.records
    assert "no Redis" in record.getMessage()


async def test_a_server_that_is_ended_while_it_starts_does_not_cost_the_data(
    state_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Out of memory, or an impatient operator: SIGKILL and SIGTERM do not blame the data."""
    program = state_dir / "ended"
    program.write_text("#!/bin/sh\nkill -KILL $$\n")
    program.chmod(0o700)
    monkeypatch.setattr(embedded, "_program", lambda: str(program))
    before = content(state_dir / damage.DATA)
    async with EmbeddedRedis(state_dir) as server:
        assert server.damaged_copies == ()
    assert content(state_dir / damage.DATA) == before
