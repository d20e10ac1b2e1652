"""Browser sessions: creation, lookup by cookie, and end at all gateways."""

import asyncio
import logging
import secrets
import time
from contextlib import suppress
from types import TracebackType
from typing import Self

from linked_fleet_gateway.extensions.sessions.ended_sessions import EndedSessions
from linked_fleet_gateway.extensions.sessions.sealed_cookie import Session, new_session, open_session, seal_session
from linked_fleet_gateway.extensions.sessions.session_key import SessionKey, StoreUnavailable
from linked_fleet_gateway.identity.rights import Credential, Identity
from linked_fleet_gateway.identity.service import Identities
from linked_fleet_gateway.runtime.background import end, supervised

log = logging.getLogger(__name__)

LOOK_S = 1.0
"""Period of checks for sessions that other gateways have ended."""
_ID_BYTES = 16


class Sessions:
    """An async context manager."""

    def __init__(self, identities: Identities, key: SessionKey, ended: EndedSessions) -> None:
        self.identities, self.key, self._ended = identities, key, ended
        self._hearing: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        try:
            await self.key.get()
            await self._ended.look()
        except StoreUnavailable as error:  # retried when a session is used
            log.warning("the store is away, sessions cannot be checked yet: %s", error)
        except Exception:
            # The boundary: whatever Redis contains, a gateway must start and stop robots.
            log.exception("sessions that have ended cannot be read; the gateway starts without them")
        self._hearing = supervised(self._hear, "hear of logouts", log, "logouts could not be heard of", LOOK_S)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await end([self._hearing] if self._hearing is not None else [])
        await self.key.aclose()
        await self._ended.aclose()

    async def find(self, sealed: str) -> tuple[Identity, Session] | None:
        """Return the caller and the session of a cookie; None if it is invalid or over. Raises StoreUnavailable."""
        session = open_session(sealed, await self.key.get())
        await self._ended.known()
        if session is None or session in self._ended:
            return None
        found = self.identities.known(session.credential)
        return None if found is None else (found, session)

    def lasts(self, session: Session) -> bool:
        """Return True until the session expires or is ended at any gateway."""
        return session not in self._ended and session.ends_ns > time.time_ns()

    async def begin(self, credential: Credential) -> str:
        """Return the cookie of a new session. Raises StoreUnavailable."""
        session = new_session(credential, secrets.token_urlsafe(_ID_BYTES), time.time_ns())
        return seal_session(session, await self.key.get())

    async def end(self, session: Session) -> None:
        """End a session: here at once, elsewhere within a second, or as soon as Redis is available."""
        with suppress(StoreUnavailable):  # sent with the next look
            await self._ended.end(session)
        self.identities.end_revoked()

    async def _hear(self) -> None:
        if not self.key.known:  # read as early as possible, because sessions must survive an outage of Redis
            await self.key.get()
        await self._ended.look()
