"""Logouts, as all gateways know them."""

import asyncio
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest
from redis_servers import Servers, single

from gateway.identity.ended import EndedSessions
from gateway.identity.rights import TokenHash
from gateway.identity.seal import Session, new_session
from gateway.store.connection import StoreUnavailable


def _session(id: str) -> Session:
    return new_session(TokenHash("ab" * 32), id, time.time_ns())


def _run(folder: Path, what: Callable[[Servers, EndedSessions, EndedSessions], Awaitable[None]]) -> None:
    async def run() -> None:
        with single(folder) as servers:
            one, other = (EndedSessions(servers.url, "fleet") for _ in range(2))
            await what(servers, one, other)
            for each in (one, other):
                await each.aclose()

    asyncio.run(run())


def test_what_is_ended_at_one_gateway_is_over_at_all_and_for_those_that_come_later(tmp_path: Path) -> None:
    async def check(servers: Servers, one: EndedSessions, other: EndedSessions) -> None:
        await other.look()
        many = [_session(str(number)) for number in range(3)]
        for each in many[:2]:
            await one.end(each)
        await other.look()
        late = EndedSessions(servers.url, "fleet")
        await late.known()
        for gateway in (one, other, late):
            assert [each in gateway for each in many] == [True, True, False]
        await late.aclose()

    _run(tmp_path, check)


def test_while_redis_is_away_it_is_over_here_and_the_others_hear_of_it_afterwards(tmp_path: Path) -> None:
    async def check(servers: Servers, one: EndedSessions, other: EndedSessions) -> None:
        await other.look()
        session = _session("during an outage")
        servers.kill()
        with pytest.raises(StoreUnavailable):
            await one.end(session)
        with pytest.raises(StoreUnavailable):
            await EndedSessions(servers.url, "fleet").known()
        assert session in one
        servers.start()
        await one.look()
        await other.look()
        assert session in other

    _run(tmp_path, check)


def test_what_would_be_over_by_now_is_forgotten(tmp_path: Path) -> None:
    async def check(servers: Servers, one: EndedSessions, other: EndedSessions) -> None:
        past, lasting = Session("past", TokenHash("ab" * 32), time.time_ns()), _session("lasting")
        for each in (past, lasting):
            await one.end(each)
        for _ in range(2):  # it is heard of once more, from Redis
            await one.look()
        assert past not in one and lasting in one

    _run(tmp_path, check)
