"""Sessions that were logged out: copies of their cookies are invalid at all gateways."""

import logging
import time
from collections import deque

from linked_fleet_gateway.extensions.sessions.sealed_cookie import Session
from linked_fleet_gateway.runtime.redis import Connection

log = logging.getLogger(__name__)

KEPT = 100_000
"""Approximate number of logouts kept in Redis."""
_AT_ONCE = 1000
_MOST_UNTOLD = 10_000


class EndedSessions:
    """A copy of all ended sessions, so that this gateway can check sessions during outages of Redis."""

    def __init__(self, url: str, namespace: str) -> None:
        self._key = f"{namespace}:identity:ended"
        self._redis = Connection(url, self._key)
        self._ends_ns: dict[str, int] = {}  # by session id: when the session would have expired anyway
        self._untold: deque[Session] = deque(maxlen=_MOST_UNTOLD)
        self._seen = ""

    async def aclose(self) -> None:
        for session in self._untold:
            log.warning("no other gateway knows that session %s was ended: Redis is away", session.id)
        await self._redis.close()

    def __contains__(self, session: Session) -> bool:
        return session.id in self._ends_ns

    async def known(self) -> None:
        """Load the ended sessions if they are unknown. Raises StoreUnavailable."""
        if not self._seen:
            await self.look()

    async def end(self, session: Session) -> None:
        """End a session: here at once, at other gateways when they look; during an outage they are told later."""
        self._ends_ns[session.id] = session.ends_ns
        self._untold.append(session)
        await self._tell()

    async def look(self) -> None:
        """Exchange ended sessions with Redis. Raises StoreUnavailable."""
        self._forget()
        await self._tell()
        while True:
            after = f"({self._seen}" if self._seen else "-"
            found = await self._redis.one("XRANGE", self._key, after, "+", "COUNT", _AT_ONCE)
            for _, said in found:
                self._ends_ns[said[b"id"].decode()] = int(said[b"ends_ns"])
            self._seen = found[-1][0].decode() if found else self._seen or "0-0"
            if len(found) < _AT_ONCE:
                return

    async def _tell(self) -> None:
        while self._untold:
            one = self._untold[0]
            said = ("id", one.id, "ends_ns", one.ends_ns)
            await self._redis.one("XADD", self._key, "MAXLEN", "~", KEPT, "*", *said)
            if self._untold and self._untold[0] is one:  # concurrent calls send too
                self._untold.popleft()

    def _forget(self) -> None:
        now_ns = time.time_ns()
        for id in [id for id, ends_ns in self._ends_ns.items() if ends_ns <= now_ns]:
            del self._ends_ns[id]
