"""Sessions that were logged out, as one gateway knows them."""

import time
from typing import Any

import pytest

from linked_fleet_gateway.extensions.sessions import service
from linked_fleet_gateway.extensions.sessions.sealed_cookie import TOKEN_SESSION_S, Session, new_session
from linked_fleet_gateway.extensions.sessions.service import EndedSessions
from linked_fleet_identity.rights import TokenHash

_BEGIN_NS = 1_800_000_000 * 10**9
_LONG_NS = 2 * TOKEN_SESSION_S * 10**9


@pytest.fixture
def ended(monkeypatch: pytest.MonkeyPatch) -> EndedSessions:
    """Return a list at a store without news."""

    async def execute(*command: object) -> list[Any]:
        return []

    made = EndedSessions("redis://127.0.0.1:1", "fleet")
    monkeypatch.setattr(made._redis, "execute", execute)
    return made


def session(id: str) -> Session:
    return new_session(TokenHash("ab" * 32), id, _BEGIN_NS)


async def test_a_session_stays_ended_when_the_clock_jumps_ahead_and_back(
    ended: EndedSessions, monkeypatch: pytest.MonkeyPatch
) -> None:
    await ended.end(session("out"))
    monkeypatch.setattr(time, "time_ns", lambda: _BEGIN_NS + _LONG_NS)
    await ended.synchronize()
    monkeypatch.setattr(time, "time_ns", lambda: _BEGIN_NS)
    assert session("out") in ended


async def test_sessions_that_have_expired_are_forgotten_when_there_are_many(
    ended: EndedSessions, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(service, "KEPT", 3)
    monkeypatch.setattr(time, "time_ns", lambda: _BEGIN_NS + _LONG_NS)
    for number in range(4):
        await ended.end(session(str(number)))
    await ended.synchronize()
    assert not any(session(str(number)) in ended for number in range(4))
