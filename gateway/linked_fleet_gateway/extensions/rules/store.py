"""Rules in Redis: what they say, what holds of each, its firings, and which gateway evaluates them.

One run of a gateway *serves* the rules, for as long as it renews its lease. Every step that could have a robot move is
taken in one script that looks whether this run still serves them and the rule still says what was evaluated: a run that
was frozen, or cut off, claims nothing when it wakes.
"""

import logging
from collections.abc import AsyncGenerator, Collection, Iterable, Mapping, Sequence
from contextlib import aclosing
from dataclasses import replace
from typing import Any

import msgspec

from linked_fleet_gateway.extensions.rules import redis_scripts as scripts
from linked_fleet_gateway.extensions.rules.redis_keys import Keys
from linked_fleet_gateway.extensions.rules.rule import Firing, FiringState, Known, Rule
from linked_fleet_gateway.runtime.redis import Connection, StoreUnavailable

__all__ = ["KEPT", "LEASE_S", "Changed", "Crowded", "Full", "Lost", "RuleStore", "StoreUnavailable"]
log = logging.getLogger(__name__)

LEASE_S = 3.0  # after that long without a word another gateway serves the rules
KEPT = 50
"""Firings of each rule."""
AT_ONCE = 16
"""Rows of one instant that fire; more are suppressed."""
MOST = 500
"""Rules that there may be."""
_NEWS = 1_000  # are kept, about


class Full(Exception):  # noqa: N818
    """The client may have no more rules."""


class Crowded(Exception):  # noqa: N818
    """There may be no more rules."""


class Changed(Exception):  # noqa: N818
    """The rule was written or deleted meanwhile."""


class Lost(Exception):  # noqa: N818
    """Another gateway serves the rules."""


class RuleStore:
    """One run of a gateway at the store. Opens without contact and heals by itself: while Redis is away every method
    but ``news`` raises StoreUnavailable, and whether the step was taken is unknown."""

    def __init__(self, url: str, namespace: str, run: str) -> None:
        self._keys = Keys(namespace)
        self._run = run
        self._redis = Connection(url, self._keys.news)

    async def close(self) -> None:
        await self._redis.close()

    # Rules

    async def write(self, rule: Rule, revision: int, limit: int) -> None:
        """Add a rule (``revision`` 0), or replace what it said at that revision; Full, Crowded, Changed."""
        keys = (self._keys.records, self._keys.revisions, self._keys.of_client(rule.client))
        body = msgspec.json.encode(rule)
        said = await self._redis.run(scripts.WRITE, keys, rule.id, body, revision, limit, MOST)
        if said == b"full":
            raise Full(rule.client)
        if said == b"crowded":
            raise Crowded
        if said == b"changed":
            raise Changed(rule.id)
        await self._tell(rule.id)

    async def remove(self, rule: Rule, revision: int | None = None) -> bool:
        """False if there was none; with a revision, Changed unless it says what it said at that."""
        keys = (self._keys.records, self._keys.revisions, self._keys.of_client(rule.client))
        arguments = (rule.id,) if revision is None else (rule.id, revision)
        removed = await self._redis.run(scripts.REMOVE, keys + self._keys.of_rule(rule.id), *arguments)
        if removed == b"changed":
            raise Changed(rule.id)
        await self._tell(rule.id)
        return bool(removed)

    async def load(self) -> dict[str, Known]:
        """All rules, by id."""
        ids = [id.decode() for id in await self._redis.one("HKEYS", self._keys.records)]
        found = [await self.read(id) for id in ids]
        return {each.rule.id: each for each in found if each is not None}

    async def read(self, id: str) -> Known | None:
        """One rule; None also for one that another version has written and this one cannot read."""
        _, counts, firings = self._keys.of_rule(id)
        keys = (self._keys.records, self._keys.revisions, counts, firings)
        body, revision, said, fired = await self._redis.run(scripts.READ, keys, id)
        if body is None or revision is None:
            return None
        try:
            rule = msgspec.json.decode(body, type=Rule)
            numbered = {int(number): _firing(text) for number, text in _pairs(fired)}
        except ValueError as error:
            log.warning("rule %s is left alone, it cannot be read: %r", id, error)
            return None
        texts = {name.decode(): text.decode() for name, text in _pairs(said)}
        return Known(
            rule,
            int(revision),
            dict(sorted(numbered.items())),
            int(texts.get("suppressed", "0")),
            fault=texts.get("fault", ""),
            begun=texts.get("begun") == revision.decode(),
            suspended=texts.get("suspended", ""),
        )

    # Serving

    async def serve(self) -> bool:
        """Serve the rules for the time of the lease, if no other run does."""
        server = await self._redis.run(scripts.SERVE, (self._keys.server,), self._run, round(LEASE_S * 1000))
        return bool(server == self._run.encode())

    async def leave(self) -> None:
        await self._redis.run(scripts.LEAVE, (self._keys.server,), self._run)

    async def seen(self) -> set[str]:
        """The robots that were there when rules were evaluated last."""
        return {name.decode() for name in await self._redis.one("SMEMBERS", self._keys.seen)}

    async def note_seen(self, came: Collection[str], left: Collection[str]) -> None:
        if came:
            await self._redis.one("SADD", self._keys.seen, *came)
        if left:
            await self._redis.one("SREM", self._keys.seen, *left)

    async def recall(self, known: Known) -> set[str] | None:
        """The keys of the rows that held when the rule was evaluated last; None if it was not since it was written."""
        said, *keys = await self._mine(scripts.RECALL, known)
        return None if said == b"new" else {key.decode() for key in keys}

    async def begin(self, known: Known, holding: Collection[str]) -> None:
        """Take what holds for what has always held."""
        await self._mine(scripts.BEGIN, known, *holding)
        await self._tell(known.rule.id)

    async def advance(self, known: Known, began: Mapping[str, Firing], ended: Collection[str]) -> list[int]:
        """Note what started and ceased to hold. The numbers of the firings that are claimed by it, of the first of
        ``began``; the others are suppressed."""
        rows = [part for key, firing in began.items() for part in (key, msgspec.json.encode(firing))]
        limits = (round(known.rule.interval_s * 1000), AT_ONCE, KEPT, len(began))
        _, *numbers = await self._mine(scripts.ADVANCE, known, *limits, *rows, *ended)
        if began:
            await self._tell(known.rule.id)
        return [int(number) for number in numbers]

    async def finish(self, rule: Rule, number: int, firing: Firing) -> None:
        """The outcome of a firing that was claimed."""
        text = firing.state.value.encode() + b" " + msgspec.json.encode(firing)
        await self._redis.run(scripts.FINISH, (self._keys.of_rule(rule.id)[2],), number, text)
        await self._tell(rule.id)

    async def complain(self, known: Known) -> None:
        """Have others know why a rule does not fire, or that it does again."""
        keys = (self._keys.server, self._keys.revisions, self._keys.of_rule(known.rule.id)[1])
        arguments = (self._run, known.rule.id, known.revision, known.fault, known.suspended)
        _heeded(await self._redis.run(scripts.COMPLAIN, keys, *arguments), known)
        await self._tell(known.rule.id)

    async def _mine(self, script: str, known: Known, *arguments: str | bytes | int) -> Any:
        keys = (self._keys.server, self._keys.revisions, *self._keys.of_rule(known.rule.id))
        answer = await self._redis.run(script, keys, self._run, known.rule.id, known.revision, *arguments)
        return _heeded(answer, known)

    # News

    async def news(self) -> AsyncGenerator[str | None, None]:
        """Ids of rules with which another run did something; None: Redis was away, and all must be read anew."""
        async with aclosing(self._redis.news()) as news:
            async for fields in news:
                if fields is None:
                    yield None
                elif fields[b"run"].decode() != self._run:
                    yield fields[b"id"].decode()

    async def _tell(self, id: str) -> None:
        await self._redis.one("XADD", self._keys.news, "MAXLEN", "~", _NEWS, "*", "id", id, "run", self._run)


def _heeded(answer: Any, known: Known) -> Any:
    if answer[0] == b"lost":
        raise Lost
    if answer[0] == b"changed":
        raise Changed(known.rule.id)
    return answer


def _firing(text: bytes) -> Firing:
    state, _, said = text.partition(b" ")
    return replace(msgspec.json.decode(said, type=Firing), state=FiringState(state.decode()))


def _pairs(answer: Sequence[bytes]) -> Iterable[tuple[bytes, bytes]]:
    """A hash, as a script gives it."""
    return zip(answer[::2], answer[1::2], strict=True)
