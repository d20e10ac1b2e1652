"""The audit: entries are read newest first, and written later if Redis is unavailable."""

import asyncio
import logging
import time
from collections.abc import Iterator

import pytest
from msgspec.structs import replace

from linked_fleet_base.errors import RedisUnavailable
from linked_fleet_gateway.api import RequestEvent
from linked_fleet_gateway.extensions.audit import log as audit_module
from linked_fleet_gateway.extensions.audit import search as search_module
from linked_fleet_gateway.extensions.audit.entry import AuditEntry
from linked_fleet_gateway.extensions.audit.log import AuditLog
from linked_fleet_gateway.extensions.audit.query import PAGE_SIZE, Query
from redis_backends import Backend, opened
from store_samples import served, until

EVERYTHING = Query()


@pytest.fixture
def audit(server: Backend) -> Iterator[AuditLog]:
    yield from opened(server, AuditLog(server.url, "fleet"))


def note(audit: AuditLog, *whats: object, by_page: bool = False) -> None:
    for what in whats:
        audit.record(RequestEvent("später\0", str(what), "/r/", "r", 204, "id", "/r/i", "why", by_page))


async def page(audit: AuditLog, query: Query = EVERYTHING) -> list[tuple[str, AuditEntry]]:
    return list((await audit.find(query)).entries)


async def noted(audit: AuditLog, count: int, query: Query = EVERYTHING) -> list[tuple[str, AuditEntry]]:
    async def found() -> list[tuple[str, AuditEntry]]:
        entries = await page(audit, query)
        return entries if len(entries) >= count else []

    return await until(found, f"{count} entries")


async def test_entries_are_read_as_they_were_noted_in_pages_newest_first(audit: AuditLog) -> None:
    note(audit, *range(PAGE_SIZE + 5))
    newest = await noted(audit, PAGE_SIZE)
    await until(lambda: page(audit, Query(before=newest[-1][0])), "the page before")
    first = await audit.find(Query())
    second = await audit.find(Query(before=first.entries[-1][0]))
    entries = [entry for _, entry in (*first.entries, *second.entries)]
    assert [entry.what for entry in entries] == [str(number) for number in reversed(range(PAGE_SIZE + 5))]
    expected = AuditEntry(entries[0].at_ns, "später\0", str(PAGE_SIZE + 4), "/r/", "r", "204", "id", "/r/i", "why")
    assert entries[0] == expected
    assert first.has_more and not second.has_more and first.newest == first.entries[0][0] == second.newest
    assert len(await page(audit, Query(after=first.entries[3][0]))) == 3


async def test_a_filter_reaches_over_all_entries(audit: AuditLog, monkeypatch: pytest.MonkeyPatch) -> None:
    """It does not matter how many are looked at by one command."""
    monkeypatch.setattr(search_module, "LOOK_AT_ONCE", 7)
    begun_ns = time.time_ns()
    for number in range(40):
        robot, who = ("ur5", "ada") if number % 20 == 3 else ("panda", "bob")
        path = f"/{robot}/elbow/actions/{'rotate' if number % 2 else 'hold'}"
        status = {3: 403, 23: None, 24: 503}.get(number, 202)
        audit.record(
            RequestEvent(who, "PUT", path, robot, status, f"id-{number}", "", "Because of ABC" * (number == 3))
        )
    audit.record(
        RequestEvent("ada", "ORDER", "/queue/7", "panda, ur5", 202, created="/ur5/elbow/actions/hold/invocations/1")
    )
    await noted(audit, 41)
    counts = {
        Query(who="ada"): 3, Query(robot="ur5"): 3, Query(robot="ur"): 0, Query(resource="/ur5/"): 3,
        Query(resource="/ur5/elb"): 0, Query(resource="/ur5/elbow"): 3, Query(action="rotate"): 20,
        Query(action="put"): 40, Query(action="rot"): 0, Query(outcome="refused"): 1, Query(outcome="failed"): 1,
        Query(outcome="ended"): 1, Query(outcome="succeeded"): 38, Query(text="because abc"): 1,
        Query(text="id-3 PANDA"): 10, Query(from_ns=begun_ns): 41, Query(from_ns=time.time_ns()): 0,
        Query(until_ns=begun_ns): 0, Query(until_ns=time.time_ns()): 41, Query(who="ada", outcome="succeeded"): 1,
    }  # fmt: skip
    assert {query: len(await page(audit, query)) for query in counts} == counts
    two = await audit.find(Query(robot="panda", limit=2))
    assert two.has_more and [each.what for _, each in two.entries] == ["ORDER", "PUT"]


async def test_what_pages_do_by_themselves_is_shown_on_demand(audit: AuditLog) -> None:
    """It is merged by time, and its pages neither repeat nor leave out anything."""
    for number in range(5):
        note(audit, f"c{number}")
        note(audit, f"p{number}", by_page=True)
    await noted(audit, 10, Query(pages=True))
    assert [entry.what for _, entry in await page(audit)] == ["c4", "c3", "c2", "c1", "c0"]
    found: list[str] = []
    query = Query(pages=True, limit=3)
    while True:
        part = await audit.find(query)
        found += [entry.what for _, entry in part.entries]
        if not part.has_more:
            break
        query = replace(query, before=part.entries[-1][0])
    assert sorted(found) == sorted([f"{kind}{number}" for kind in "cp" for number in range(5)])
    newest = (await audit.find(Query(pages=True))).entries[4][0]
    assert len(await page(audit, Query(pages=True, after=newest))) == 4


async def test_entries_made_during_an_outage_are_stored_in_order(server: Backend, audit: AuditLog) -> None:
    note(audit, 1)
    await noted(audit, 1)
    server.kill()
    note(audit, 2, 3)
    with pytest.raises(RedisUnavailable):
        await page(audit)
    server.start()
    await served(lambda: page(audit))
    entries = [entry.what for _, entry in await noted(audit, 3)]
    assert entries == ["3", "2", "1"]


async def test_the_rest_is_written_when_a_gateway_ends(server: Backend) -> None:
    async with AuditLog(server.url, "fleet") as ending:
        note(ending, 1, 2)
    async with AuditLog(server.url, "fleet") as later:
        assert [entry.what for _, entry in await page(later)] == ["2", "1"]


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
        await served(lambda: page(audit))
        assert [entry.what for _, entry in await noted(audit, 3)] == ["4", "3", "2"]
    assert [record.getMessage() for record in caplog.records if record.levelno == logging.WARNING] == [
        "the oldest entry that waits for Redis is given up; the log has it"
    ] * 2
