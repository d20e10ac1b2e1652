"""Rules in Redis: definitions, rows that hold, firings, and the gateway that evaluates them.

One run of a gateway *serves* the rules while it renews its lease. Every step that could make a robot move is a script
that checks that this run still serves and that the rule has not changed. So a run that was frozen or disconnected
claims nothing when it resumes.
"""

import logging
from collections.abc import AsyncGenerator, Collection, Iterable, Mapping, Sequence
from contextlib import aclosing
from dataclasses import replace
from typing import Any

import msgspec

from linked_fleet_gateway.extensions.rules import redis_scripts as scripts
from linked_fleet_gateway.extensions.rules.redis_scripts import Keys
from linked_fleet_gateway.extensions.rules.rule import Firing, FiringState, Rule, RuleRecord
from linked_fleet_gateway.serving import RedisConnection

__all__ = ["KEPT", "LEASE_S", "Changed", "FleetFull", "Full", "Lost", "RuleStore"]
log = logging.getLogger(__name__)

LEASE_S = 3.0  # after this time without renewal another gateway takes over
KEPT = 50
"""Firings kept for each rule."""
AT_ONCE = 16
"""Most rows that fire at one instant; others are suppressed."""
MOST = 500
"""Most rules of the fleet."""
_NEWS = 1_000  # entries kept, approximately


class Full(Exception):  # noqa: N818
    """The client has too many rules."""


class FleetFull(Exception):  # noqa: N818
    """The fleet has too many rules."""


class Changed(Exception):  # noqa: N818
    """The rule was written or deleted concurrently."""


class Lost(Exception):  # noqa: N818
    """Another gateway serves the rules."""


class RuleStore:
    """Access of one run of a gateway to the store; opens without contact and reconnects by itself.

    During an outage every method except ``news`` raises RedisUnavailable, and it is unknown if the step was executed.
    """

    def __init__(self, url: str, namespace: str, run: str) -> None:
        self._keys = Keys(namespace)
        self._run = run
        self._redis = RedisConnection(url, self._keys.news)

    async def close(self) -> None:
        await self._redis.close()

    # Rules

    async def write(self, rule: Rule, revision: int, limit: int) -> None:
        """Add a rule (``revision`` 0), or replace that revision. Raises Full, FleetFull, Changed."""
        arguments = (rule.id, msgspec.json.encode(rule), revision, limit, MOST, self._run, _NEWS)
        said = await self._redis.run_script(scripts.WRITE, self._keys_of_writes(rule), *arguments)
        if said == b"full":
            raise Full(rule.client)
        if said == b"crowded":
            raise FleetFull
        if said == b"changed":
            raise Changed(rule.id)

    async def remove(self, rule: Rule, revision: int | None = None) -> bool:
        """Remove a rule. Return False if there was none. Raises Changed if ``revision`` is given and differs."""
        keys = self._keys_of_writes(rule) + self._keys.keys_of_rule(rule.id)
        only = () if revision is None else (revision,)
        removed = await self._redis.run_script(scripts.REMOVE, keys, rule.id, self._run, _NEWS, *only)
        if removed == b"changed":
            raise Changed(rule.id)
        return bool(removed)

    def _keys_of_writes(self, rule: Rule) -> tuple[str, ...]:
        return self._keys.records, self._keys.revisions, self._keys.rules_of_client(rule.client), self._keys.news

    async def load(self) -> dict[str, RuleRecord]:
        """Return all rules by id."""
        ids = [id.decode() for id in await self._redis.execute("HKEYS", self._keys.records)]
        found = [await self.read(id) for id in ids]
        return {each.rule.id: each for each in found if each is not None}

    async def read(self, id: str) -> RuleRecord | None:
        """Return one rule; None also if another version wrote it in an unreadable form."""
        _, counts, firings = self._keys.keys_of_rule(id)
        keys = (self._keys.records, self._keys.revisions, counts, firings)
        body, revision, said, fired = await self._redis.run_script(scripts.READ, keys, id)
        if body is None or revision is None:
            return None
        try:
            rule = msgspec.json.decode(body, type=Rule)
            numbered = {int(number): _firing(text) for number, text in _pairs(fired)}
        except ValueError as error:
            log.warning("rule %s is ignored, because it cannot be read: %r", id, error)
            return None
        texts = {name.decode(): text.decode() for name, text in _pairs(said)}
        return RuleRecord(
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
        """Take or renew the lease, unless another run has it. Return True if this run serves."""
        server = await self._redis.run_script(scripts.SERVE, (self._keys.server,), self._run, round(LEASE_S * 1000))
        return bool(server == self._run.encode())

    async def leave(self) -> None:
        await self._redis.run_script(scripts.LEAVE, (self._keys.server,), self._run)

    async def online_robots(self) -> set[str]:
        """Return the robots that were online at the last evaluation."""
        return {name.decode() for name in await self._redis.execute("SMEMBERS", self._keys.seen)}

    async def update_online_robots(self, came: Collection[str], left: Collection[str]) -> None:
        if came:
            await self._redis.execute("SADD", self._keys.seen, *came)
        if left:
            await self._redis.execute("SREM", self._keys.seen, *left)

    async def rows_held(self, known: RuleRecord) -> set[str] | None:
        """Return the keys of the rows that held at the last evaluation; None without one since the rule was written."""
        said, *keys = await self._run_while_serving(scripts.RECALL, known)
        return None if said == b"new" else {key.decode() for key in keys}

    async def store_first_rows(self, known: RuleRecord, holding: Collection[str]) -> None:
        """Store the rows that hold at the first evaluation."""
        await self._run_while_serving(scripts.BEGIN, known, *holding)
        await self._tell(known.rule.id)

    async def advance(self, known: RuleRecord, began: Mapping[str, Firing], ended: Collection[str]) -> list[int]:
        """Store changed rows.

        Return the numbers of the firings claimed for the first of ``began``; others are suppressed.
        """
        rows = [part for key, firing in began.items() for part in (key, msgspec.json.encode(firing))]
        limits = (round(known.rule.interval_s * 1000), AT_ONCE, KEPT, len(began))
        _, *numbers = await self._run_while_serving(scripts.ADVANCE, known, *limits, *rows, *ended)
        if began:
            await self._tell(known.rule.id)
        return [int(number) for number in numbers]

    async def finish(self, rule: Rule, number: int, firing: Firing) -> None:
        """Store the result of a claimed firing."""
        text = firing.state.value.encode() + b" " + msgspec.json.encode(firing)
        await self._redis.run_script(scripts.FINISH, (self._keys.keys_of_rule(rule.id)[2],), number, text)
        await self._tell(rule.id)

    async def store_fault(self, known: RuleRecord) -> None:
        """Store the reason why a rule is not evaluated; an empty ``fault`` and ``suspended`` clear it."""
        keys = (self._keys.server, self._keys.revisions, self._keys.keys_of_rule(known.rule.id)[1])
        arguments = (self._run, known.rule.id, known.revision, known.fault, known.suspended)
        _checked(await self._redis.run_script(scripts.COMPLAIN, keys, *arguments), known)
        await self._tell(known.rule.id)

    async def _run_while_serving(self, script: str, known: RuleRecord, *arguments: str | bytes | int) -> Any:
        keys = (self._keys.server, self._keys.revisions, *self._keys.keys_of_rule(known.rule.id))
        answer = await self._redis.run_script(script, keys, self._run, known.rule.id, known.revision, *arguments)
        return _checked(answer, known)

    # News

    async def news(self) -> AsyncGenerator[str | None, None]:
        """Yield ids of rules changed by another run; None after an outage, when all must be read again."""
        async with aclosing(self._redis.stream_entries()) as news:
            async for fields in news:
                if fields is None:
                    yield None
                elif fields[b"run"].decode() != self._run:
                    yield fields[b"id"].decode()

    async def _tell(self, id: str) -> None:
        await self._redis.execute("XADD", self._keys.news, "MAXLEN", "~", _NEWS, "*", "id", id, "run", self._run)


def _checked(answer: Any, known: RuleRecord) -> Any:
    if answer[0] == b"lost":
        raise Lost
    if answer[0] == b"changed":
        raise Changed(known.rule.id)
    return answer


def _firing(text: bytes) -> Firing:
    state, _, said = text.partition(b" ")
    return replace(msgspec.json.decode(said, type=Firing), state=FiringState(state.decode()))


def _pairs(answer: Sequence[bytes]) -> Iterable[tuple[bytes, bytes]]:
    """Return the pairs of a hash in a script's answer."""
    return zip(answer[::2], answer[1::2], strict=True)
