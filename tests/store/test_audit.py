"""The audit: entries are read newest first, and written later if Redis is unavailable."""

import asyncio
import logging
from collections.abc import Iterator

import pytest

from linked_fleet_gateway.base.errors import RedisUnavailable
from linked_fleet_gateway.extensions.audit import log as audit_module
from linked_fleet_gateway.extensions.audit.log import PAGE_SIZE, AuditEntry, AuditLog
from redis_backends import Backend, opened
from store_samples import served, until


@pytest.fixture
def audit(server: Backend) -> Iterator[AuditLog]:
    yield from opened(server, AuditLog(server.url, "fleet"))


def note(audit: AuditLog, *whats: object) -> None:
    for what in whats:
        audit.record("später\0", str(what), "/r/", "r", "204", "id", "/r/i")


async def noted(audit: AuditLog, count: int) -> list[tuple[str, AuditEntry]]:
    async def page() -> list[tuple[str, AuditEntry]]:
        found = await audit.read_page("")
        return found if len(found) >= count else []

    return await until(page, f"{count} entries")


async def test_entries_are_read_as_they_were_noted_in_pages_newest_first(audit: AuditLog) -> None:
    note(audit, *range(PAGE_SIZE + 5))
    newest = await noted(audit, PAGE_SIZE)
    await until(lambda: audit.read_page(newest[-1][0]), "the page before")
    entries = [
        entry for _, entry in (*await audit.read_page(""), *await audit.read_page((await audit.read_page(""))[-1][0]))
    ]
    assert [entry.what for entry in entries] == [str(number) for number in reversed(range(PAGE_SIZE + 5))]
    assert entries[0] == AuditEntry(entries[0].at_ns, "später\0", str(PAGE_SIZE + 4), "/r/", "r", "204", "id", "/r/i")
    for wrong in ("x", "1", "1-2-3", "-"):
        with pytest.raises(ValueError, match="is no id of an entry"):
            await audit.read_page(wrong)


async def test_entries_made_during_an_outage_are_stored_in_order(server: Backend, audit: AuditLog) -> None:
    note(audit, 1)
    await noted(audit, 1)
    server.kill()
    note(audit, 2, 3)
    with pytest.raises(RedisUnavailable):
        await audit.read_page("")
    server.start()
    await served(lambda: audit.read_page(""))
    entries = [entry.what for _, entry in await noted(audit, 3)]
    assert entries == ["3", "2", "1"]


async def test_the_rest_is_written_when_a_gateway_ends(server: Backend) -> None:
    async with AuditLog(server.url, "fleet") as ending:
        note(ending, 1, 2)
    async with AuditLog(server.url, "fleet") as later:
        assert [entry.what for _, entry in await later.read_page("")] == ["2", "1"]


@pytest.mark.parametrize("server", ["memory"], indirect=True)
async def test_beyond_the_limit_the_oldest_entry_is_dropped_and_logged(
    server: Backend, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(audit_module, "MAX_WAITING", 3)
    server.kill()
    async with AuditLog(server.url, "fleet") as audit:
        with caplog.at_level(logging.WARNING):
            note(audit, *range(5))
        await asyncio.sleep(5)
        server.start()
        await served(lambda: audit.read_page(""))
        assert [entry.what for _, entry in await noted(audit, 3)] == ["4", "3", "2"]
    assert [record.getMessage() for record in caplog.records if record.levelno == logging.WARNING] == [
        "the oldest entry that waits for Redis is given up; the log has it"
    ] * 2
