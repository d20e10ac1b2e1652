"""The extension ``sessions``: browser login, with a token or at an issuer."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from linked_fleet_gateway.extensions.sessions.ended_sessions import EndedSessions
from linked_fleet_gateway.extensions.sessions.scheme import SessionScheme
from linked_fleet_gateway.extensions.sessions.service import Sessions
from linked_fleet_gateway.extensions.sessions.session_key import SessionKey
from linked_fleet_gateway.extensions.sessions.settings import SessionSettings
from linked_fleet_gateway.http.extension import Core, Extension, Mount


class SessionsExtension(Extension):
    name = "sessions"
    at_root = ("login", "logout")
    needs = ("pages",)
    settings = SessionSettings

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        if core.identities is None:
            yield Mount()
            return
        key = SessionKey(core.redis_url, core.namespace, str(core.section(SessionSettings).key_file or ""))
        ended = EndedSessions(core.redis_url, core.namespace)
        async with Sessions(core.identities, key, ended) as sessions:
            yield Mount(scheme=SessionScheme(sessions))
