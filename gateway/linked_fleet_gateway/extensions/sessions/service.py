"""Browser sessions: creation, lookup by cookie, and end at all gateways.

Gateways share two things through Redis: the key that seals sessions, and the sessions that were logged out. Copies of
the cookies of the latter are invalid at all gateways.
"""

import asyncio
import base64
import logging
import secrets
import time
from collections import deque
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from linked_fleet_base.errors import RedisUnavailable
from linked_fleet_gateway.api import cancel_tasks, supervised
from linked_fleet_gateway.extensions.sessions.invitations import Invitations
from linked_fleet_gateway.extensions.sessions.sealed_cookie import (
    KEY_BYTES,
    Session,
    new_session,
    open_session,
    seal_session,
)
from linked_fleet_gateway.faces import Credential, Identity
from linked_fleet_gateway.serving import Identities, RedisConnection

log = logging.getLogger(__name__)


class SessionKey:
    """A key of 32 random bytes, created by the first gateway and cached by each, so that Redis may be unavailable
    later.

    ``file`` is a path of the key in base64 to use instead, or empty.
    """

    def __init__(self, url: str, namespace: str, file: str) -> None:
        self._redis = RedisConnection(url, f"{namespace}:identity:news")
        self._name = f"{namespace}:identity:session-key"
        self._key = read_key(Path(file)) if file else b""
        self._turn = asyncio.Lock()

    async def aclose(self) -> None:
        await self._redis.close()

    @property
    def known(self) -> bool:
        return bool(self._key)

    async def get(self) -> bytes:
        """Return the key. Raises RedisUnavailable if it was never read."""
        async with self._turn:
            if not self._key:
                await self._redis.execute("SET", self._name, secrets.token_bytes(KEY_BYTES), "NX")
                found: bytes | None = await self._redis.execute("GET", self._name)
                if found is None or len(found) != KEY_BYTES:
                    raise RedisUnavailable("the key of sessions is not in Redis")
                self._key = found
        return self._key


def read_key(path: Path) -> bytes:
    """Read the key from a file. Raises ValueError if it is invalid."""
    try:
        key = base64.b64decode(path.read_bytes().strip(), validate=True)
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}") from error
    except ValueError as error:
        raise ValueError(f"{path}: the key of sessions is in base64") from error
    if len(key) != KEY_BYTES:
        raise ValueError(f"{path} has {len(key)} bytes; the key of sessions has {KEY_BYTES}, in base64")
    return key


KEPT = 100_000
"""Approximate number of logouts kept in Redis."""
_AT_ONCE = 1000
_MOST_UNTOLD = 10_000


class EndedSessions:
    """A copy of all ended sessions, so that this gateway can check sessions during outages of Redis."""

    def __init__(self, url: str, namespace: str) -> None:
        self._key = f"{namespace}:identity:ended"
        self._redis = RedisConnection(url, self._key)
        self._ends_ns: dict[str, int] = {}  # by session id: when the session would have expired anyway
        self._untold: deque[Session] = deque(maxlen=_MOST_UNTOLD)
        self._seen = ""

    async def aclose(self) -> None:
        for session in self._untold:
            log.warning("no other gateway knows that session %s was ended: Redis is unavailable", session.id)
        await self._redis.close()

    def __contains__(self, session: Session) -> bool:
        return session.id in self._ends_ns

    async def ensure_loaded(self) -> None:
        """Load the ended sessions if they are unknown. Raises RedisUnavailable."""
        if not self._seen:
            await self.synchronize()

    async def end(self, session: Session) -> None:
        """End a session: here at once, at other gateways at their next check, or after an outage of Redis."""
        self._ends_ns[session.id] = session.ends_ns
        self._untold.append(session)
        await self._tell()

    async def synchronize(self) -> None:
        """Exchange ended sessions with Redis. Raises RedisUnavailable."""
        self._forget()
        await self._tell()
        while True:
            after = f"({self._seen}" if self._seen else "-"
            found = await self._redis.execute("XRANGE", self._key, after, "+", "COUNT", _AT_ONCE)
            for _, said in found:
                self._ends_ns[said[b"id"].decode()] = int(said[b"ends_ns"])
            self._seen = found[-1][0].decode() if found else self._seen or "0-0"
            if len(found) < _AT_ONCE:
                return

    async def _tell(self) -> None:
        while self._untold:
            one = self._untold[0]
            said = ("id", one.id, "ends_ns", one.ends_ns)
            await self._redis.execute("XADD", self._key, "MAXLEN", "~", KEPT, "*", *said)
            if self._untold and self._untold[0] is one:  # concurrent calls send too
                self._untold.popleft()

    def _forget(self) -> None:
        """Forget expired sessions once there are many, because a clock that went ahead may be set back."""
        if len(self._ends_ns) <= KEPT:
            return
        now_ns = time.time_ns()
        for id in [id for id, ends_ns in self._ends_ns.items() if ends_ns <= now_ns]:
            del self._ends_ns[id]


LOOK_S = 1.0
"""Period of checks for sessions that other gateways have ended."""
_ID_BYTES = 16
_MOST_SEEN = 1000


class Sessions:
    """An async context manager."""

    def __init__(self, identities: Identities, key: SessionKey, ended: EndedSessions) -> None:
        self.identities, self.key, self._ended = identities, key, ended
        self.invitations: Invitations | None = None
        self.seen_s: dict[str, float] = {}
        """Times at which people were last here, by name (monotonic), the latest last."""
        self._hearing: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        try:
            await self.key.get()
            await self._ended.synchronize()
        except RedisUnavailable as error:  # retried when a session is used
            log.warning("sessions cannot be checked yet: %s", error)
        except Exception:
            # The boundary: whatever Redis contains, a gateway must start and stop robots.
            log.exception("sessions that have ended cannot be read; the gateway starts without them")
        self._hearing = supervised(self._hear, "read logouts", log, "logouts at other gateways are unknown", LOOK_S)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await cancel_tasks([self._hearing] if self._hearing is not None else [])
        await self.key.aclose()
        await self._ended.aclose()

    async def find(self, sealed: str) -> tuple[Identity, Session] | None:
        """Return the caller and the session of a cookie; None if it is invalid or over. Raises RedisUnavailable."""
        session = open_session(sealed, await self.key.get())
        await self._ended.ensure_loaded()
        if session is None or session in self._ended:
            return None
        found = self.identities.identity_of(session.credential)
        if found is None:
            return None
        self.seen_s.pop(found.name, None)
        self.seen_s[found.name] = time.monotonic()
        if len(self.seen_s) > _MOST_SEEN:
            del self.seen_s[next(iter(self.seen_s))]
        return found, session

    def is_valid(self, session: Session) -> bool:
        """Return True until the session expires or is ended at any gateway."""
        return session not in self._ended and session.ends_ns > time.time_ns()

    async def begin(self, credential: Credential) -> str:
        """Return the cookie of a new session. Raises RedisUnavailable."""
        session = new_session(credential, secrets.token_urlsafe(_ID_BYTES), time.time_ns())
        return seal_session(session, await self.key.get())

    async def end(self, session: Session) -> None:
        """End a session: here at once, at other gateways within a second, or as soon as Redis is available."""
        with suppress(RedisUnavailable):  # sent with the next look
            await self._ended.end(session)
        self.identities.end_revoked()

    async def _hear(self) -> None:
        if not self.key.known:  # read as early as possible, because sessions must survive an outage of Redis
            await self.key.get()
        await self._ended.synchronize()
