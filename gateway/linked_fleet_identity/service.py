"""Identities: reloads the file, verifies tokens, and ends streams when a right ends."""

import asyncio
import logging
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from linked_fleet_identity.issuers import BadToken, IssuerKeys, Web, claimed_issuer, expiry_ns, verify_token
from linked_fleet_identity.rights import Credential, Identity, Right, TokenHash, View
from linked_fleet_identity.roster import BadRoster, Issuer, Roster, read_roster
from linked_fleet_runtime.background import cancel_tasks, supervised

log = logging.getLogger(__name__)

LOOK_S = 1.0
"""Period of checks of the file and of expired rights."""
_Stamp = tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class _Guarded:
    """A stream that must end when ``identity`` loses the rights or its credentials become invalid."""

    identity: Identity
    robot: str | None
    end: Callable[[], None]
    holds: Callable[[], bool]
    needed: Sequence[Right]


class Identities:
    """An async context manager.

    Raises BadRoster if the file is unusable at the start; later the last good one is kept.
    """

    def __init__(self, path: Path) -> None:
        import_module("jwt")  # needed with identities, and too slow to import within the first request
        self._path = path
        self._stamp = _stamp(path)
        self.roster: Roster = read_roster(path)
        self.web = Web()
        self._keys: dict[str, IssuerKeys] = {}
        self.find_elsewhere: Callable[[TokenHash], Identity | None] = lambda credential: None
        """Returns the identity of a token that an extension knows, and the file does not; else None."""
        self._guarded: set[_Guarded] = set()
        self._complaint = ""
        self._looking: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        self._looking = supervised(self._look, "look at identities", log, "identities could not be looked at", LOOK_S)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await cancel_tasks([self._looking] if self._looking is not None else [])
        for keys in self._keys.values():
            await keys.aclose()
        await self.web.aclose()

    # -- who ----------------------------------------------------------------------------------------------------------

    async def bearer(self, text: str) -> Identity:
        """Return the identity of a token. Raises BadToken, IssuerFailed."""
        return self._known(self.roster.token(text) or await self._issued(text))

    def static_token_identity(self, text: str) -> Identity | None:
        """Return the identity of a token in the file; None for any other, and for one that has expired."""
        return self.roster.identity(self.roster.token(text), time.time_ns())

    def identity_of(self, credential: Credential) -> Identity | None:
        """Return the identity of a credential verified before; None if it is no longer valid."""
        found = self.roster.identity(credential, time.time_ns())
        if found is None and isinstance(credential, TokenHash):
            found = self.find_elsewhere(credential)
            expired = found is not None and found.expires_ns is not None and found.expires_ns <= time.time_ns()
            return None if expired else found
        return found

    def keys(self, issuer: Issuer) -> IssuerKeys:
        return self._keys.setdefault(issuer.url, IssuerKeys(self.web, issuer.url))

    async def verify(self, token: str, issuer: Issuer, audience: str) -> dict[str, Any]:
        """Return the claims of a token of the issuer for an audience. Raises BadToken, IssuerFailed."""
        return await verify_token(token, issuer, self.keys(issuer), audience)

    async def _issued(self, text: str) -> Credential:
        issuer = self.roster.issuers.get(claimed_issuer(text) or "")
        if issuer is None:
            raise BadToken("it is unknown")
        said = await self.verify(text, issuer, issuer.audience)
        claims = issuer.claims(said, expiry_ns(said))
        if claims is None:
            raise BadToken(f"it has no usable claim {issuer.name_claim}")
        return claims

    def _known(self, credential: Credential) -> Identity:
        found = self.roster.identity(credential, time.time_ns())
        if found is None:
            raise BadToken("it has expired")
        return found

    # -- as long as --------------------------------------------------------------------------------------------------

    @contextmanager
    def watch_rights(
        self,
        identity: Identity,
        robot: str | None,
        end: Callable[[], None],
        holds: Callable[[], bool],
        needed: Sequence[Right] = (),
    ) -> Iterator[None]:
        """Call ``end`` periodically once the caller must lose the stream.

        That is when ``identity`` may no longer subscribe, sees other robots, or ``holds`` returns False; for the fleet
        also when it may subscribe to other robots. ``needed``: rights, one of which it must have beside.
        """
        guarded = _Guarded(identity, robot, end, holds, needed)
        self._guarded.add(guarded)
        try:
            yield
        finally:
            self._guarded.discard(guarded)

    def _lasts(self, guarded: _Guarded) -> bool:
        if not guarded.holds():
            return False
        before, credential = guarded.identity, guarded.identity.credential
        now = None if credential is None else self.identity_of(credential)
        if now is None or not _subscribes(now, guarded.robot, before.visible_robots, guarded.needed):
            return False
        # A stream of the fleet may have all its robots.
        return guarded.robot is not None or now.view_for(Right.SUBSCRIBE) == before.view_for(Right.SUBSCRIBE)

    def may_continue(self, creator: str, robot: str | None, sees: View, needed: Sequence[Right] = ()) -> bool:
        """Return True if a callback of ``creator``, who saw the robots of ``sees`` when creating it, may continue.

        ``needed``: rights, one of which it must have beside.

        Subjects of issuers are not checked again, because only a new token would show their present rights.
        """
        subject, at, issuer = creator.rpartition("@")
        if at:
            return bool(subject) and any(each.name == issuer for each in self.roster.issuers.values())
        now = self.roster.holder(creator, time.time_ns())
        return now is not None and _subscribes(now, robot, sees, needed)

    # -- the file ------------------------------------------------------------------------------------------------------

    async def _look(self) -> None:
        await self._look_at_file()
        self.end_revoked()

    async def _look_at_file(self) -> None:
        try:
            stamp = _stamp(self._path)
            if stamp == self._stamp:
                return
            self.roster = await asyncio.to_thread(read_roster, self._path)
        except BadRoster as error:
            if str(error) != self._complaint:
                log.error("the identities stay as they were: %s", error)
            self._complaint = str(error)
            return
        self._stamp, self._complaint = stamp, ""
        log.info("identities read anew: %d tokens, %d issuers", len(self.roster.tokens), len(self.roster.issuers))

    def end_revoked(self) -> None:
        """End all streams whose caller has lost the right."""
        for each in list(self._guarded):
            if not self._lasts(each):
                each.end()


def _subscribes(now: Identity, robot: str | None, sees: View, needed: Sequence[Right]) -> bool:
    """Return True if somebody may subscribe, has one of the rights that are needed beside, and sees the same robots."""
    subscribes = now.has_right(Right.SUBSCRIBE, robot) and now.has_right(Right.READ, robot)
    return subscribes and (not needed or now.has_any_right(needed, None)) and now.visible_robots == sees


def _stamp(path: Path) -> _Stamp:
    """Return the stamp of the file. Raises BadRoster if it does not exist."""
    try:
        found = path.stat()
    except OSError as error:
        raise BadRoster(f"{path}: {error.strerror}") from error
    return found.st_mtime_ns, found.st_size, found.st_ino
