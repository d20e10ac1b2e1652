"""Logouts and the key of sessions, as known to all gateways."""

import asyncio
import time
from collections.abc import Iterator
from contextlib import aclosing

import pytest

from linked_fleet_base.errors import RedisUnavailable
from linked_fleet_gateway.extensions.sessions import service
from linked_fleet_gateway.extensions.sessions.sealed_cookie import Session, new_session
from linked_fleet_gateway.extensions.sessions.service import EndedSessions, SessionKey
from linked_fleet_identity.rights import TokenHash
from redis_backends import Backend, opened
from store_samples import served


@pytest.fixture
def a(server: Backend) -> Iterator[EndedSessions]:
    yield from opened(server, aclosing(EndedSessions(server.url, "fleet")))


@pytest.fixture
def b(server: Backend) -> Iterator[EndedSessions]:
    yield from opened(server, aclosing(EndedSessions(server.url, "fleet")))


def a_session(id: str) -> Session:
    return new_session(TokenHash("ab" * 32), id, time.time_ns())


async def test_a_session_ended_at_one_gateway_is_over_at_all(
    server: Backend, a: EndedSessions, b: EndedSessions
) -> None:
    await b.synchronize()
    many = [a_session(str(number)) for number in range(3)]
    for each in many[:2]:
        await a.end(each)
    await b.synchronize()
    async with aclosing(EndedSessions(server.url, "fleet")) as late:
        await late.ensure_loaded()
        for gateway in (a, b, late):
            assert [each in gateway for each in many] == [True, True, False]


async def test_a_session_ended_in_an_outage_is_over_elsewhere_afterwards(
    server: Backend, a: EndedSessions, b: EndedSessions
) -> None:
    await b.synchronize()
    session = a_session("during an outage")
    server.kill()
    with pytest.raises(RedisUnavailable):
        await a.end(session)
    assert session in a
    server.start()
    await served(a.synchronize)
    await served(b.synchronize)
    assert session in b


async def test_expired_entries_are_forgotten_when_there_are_many(
    a: EndedSessions, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(service, "KEPT", 1)
    past, lasting = Session("past", TokenHash("ab" * 32), time.time_ns()), a_session("lasting")
    for each in (past, lasting):
        await a.end(each)
    for _ in range(2):  # it arrives once more, from Redis
        await a.synchronize()
    assert past not in a and lasting in a


async def test_gateways_share_a_key_and_keep_it_while_redis_is_away(server: Backend) -> None:
    one, other, elsewhere, late = (SessionKey(server.url, name, "") for name in ("fleet", "fleet", "another", "fleet"))
    first, second, third = await asyncio.gather(one.get(), other.get(), elsewhere.get())
    assert first == second and len(first) == 32 and third != first
    server.kill()
    assert await one.get() == first
    with pytest.raises(RedisUnavailable):
        await late.get()
    server.start()
    assert await late.get() == first
    for each in (one, other, elsewhere, late):
        await each.aclose()
