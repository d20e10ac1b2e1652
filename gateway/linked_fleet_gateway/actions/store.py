"""Invocations, leases and settings of robots in Redis, shared by all gateways.

What is asked is decided in one step where the robot's keys live, then the other gateways are told. What could not be
told, because Redis went away between the two, is told later; whoever listens hears of each outage and reads anew.
"""

import asyncio
import logging
import time
import uuid
from collections.abc import AsyncGenerator, Sequence
from contextlib import aclosing
from dataclasses import dataclass
from typing import Literal, Self, cast, get_args

import msgspec

from linked_fleet_gateway.actions import redis_scripts as scripts
from linked_fleet_gateway.actions.redis_keys import Keys, hashed, robot_of, tag
from linked_fleet_gateway.fleet.invocations import MAX_TERMINAL, Invocation
from linked_fleet_gateway.fleet.lease import Lease
from linked_fleet_gateway.runtime.background import finish, supervised
from linked_fleet_gateway.runtime.cancellation import end
from linked_fleet_gateway.runtime.redis import GATHER_S, Connection, StoreUnavailable, heed_cancellation

__all__ = ["KEPT_S", "ActionStore", "Full", "KeyReused", "Lease", "LeaseHeld", "LeaseOver", "News", "StoreUnavailable"]
_log = logging.getLogger(__name__)

KEPT_S = 86_400.0  # an invocation after its end, and an idempotency key after its use
_NEWS = 10_000  # are kept, about; also how many that could not be told yet
_LAST_S = 0.5  # to tell the rest when this gateway ends
_MS = 1_000_000  # nanoseconds

What = Literal["invocation", "deleted", "lease", "settings"]


@dataclass(frozen=True)
class News:
    """A change by another run: of an invocation, a lease or a setting, of which ``id`` is the id, token or name."""

    what: What
    robot: str = ""
    id: str = ""


class LeaseHeld(Exception):  # noqa: N818
    """Someone else has the lease."""

    def __init__(self, lease: Lease) -> None:
        super().__init__(f"{lease.holder} has the lease of {lease.robot or 'the fleet'}")
        self.lease = lease


class LeaseOver(Exception):  # noqa: N818
    """The lease that an invocation is tied to is not held now."""


class Full(Exception):  # noqa: N818
    """The client may have no more open invocations."""


class KeyReused(Exception):  # noqa: N818
    """The idempotency key was used for another request, less than a day ago."""


class ActionStore:
    """One run of a gateway at the store, as an async context manager; ``run`` is unique to it.

    A robot "" is the fleet as a whole. Opens without contact and heals by itself: while Redis is away every method but
    ``news`` raises StoreUnavailable, and whether the step was taken is unknown. ValueError for a URL, a namespace or a
    robot's name that means nothing.
    """

    def __init__(self, url: str, namespace: str, run: str, kept_s: float = KEPT_S) -> None:
        self._keys = Keys(namespace)
        self._run = run
        self._kept_s = kept_s
        self._redis = Connection(url, self._keys.news)
        self._untold: dict[News, None] = {}
        """In the order of the last time that each became news: several changes of one thing are told once."""
        self._to_tell = asyncio.Event()
        self._noted: dict[str, tuple[int, int]] = {}
        self._tasks: list[asyncio.Task[None]] = []

    async def __aenter__(self) -> Self:
        failed = "other gateways have not been told"
        self._tasks = [supervised(self._tell_others, "tell other gateways", _log, failed, GATHER_S)]
        return self

    async def __aexit__(self, *_: object) -> None:
        await end(self._tasks)
        await finish(self._tell_rest(), _log, "other gateways have not been told everything", _LAST_S)
        await self._redis.close()

    # Invocations

    async def open(
        self, invocation: Invocation, *, token: str = "", key: str = "", digest: str = "", unasked: bool = False,
        full: bool = False,
    ) -> str | None:  # fmt: skip
        """Accept an invocation, or say the id of the earlier one that the same client's request already is.

        LeaseHeld unless ``token`` is that of the lease, if there is one; LeaseOver when the invocation is tied to a
        lease that is not held. ``key`` is an idempotency key and ``digest`` stands for its request: KeyReused when it
        was used with another one less than a day ago. ``unasked``: whoever has a lease. ``full``: the
        client may have no more; Full, unless the request is a repeated one.
        May be repeated with the same invocation after StoreUnavailable.
        """
        robot = invocation.robot
        keys: tuple[str, ...] = (*self._keys.invocations(robot), self._keys.lease(robot))
        rules = (scripts.ANYBODY if unasked else _secret(token), invocation.lease)
        once: tuple[str | int, ...] = ()
        if key:
            once = digest, _ms(self._kept_s)
            keys += (self._keys.repeat(robot, key),)
        await self._note(robot)
        answer = await self._redis.run(
            scripts.OPEN, keys, *rules, *self._written(invocation), MAX_TERMINAL, int(full), *once
        )
        said, *rest = _granted(robot, answer, invocation.lease)
        if said == b"reused":
            raise KeyReused(key)
        if said == b"full":
            raise Full(invocation.client)
        if said == b"repeated":
            return rest[0].decode()
        self._tell("invocation", robot, invocation.id)
        return None

    async def check(self, robot: str, token: str, lease: str = "") -> None:
        """Check the lease as ``open`` does, and nothing else: LeaseHeld, LeaseOver."""
        answer = await self._redis.run(scripts.CHECK, (self._keys.lease(robot),), _secret(token), lease)
        _granted(robot, answer, lease)

    async def save(self, invocation: Invocation) -> bool:
        """Write what became of an invocation; False, and nothing is written, if it was deleted or over already.

        May be repeated after StoreUnavailable: the same once more is True again.
        Others are told, of an acceptance too: only who asked knows how long it takes, and when it is late.
        """
        return (await self.save_all([invocation]))[0]

    async def save_all(self, invocations: Sequence[Invocation]) -> list[bool]:
        """``save`` for many at once."""
        answers = await self._redis.all(
            [
                ("EVAL", scripts.SAVE, len(keys), *keys, *self._written(each))
                for each in invocations
                for keys in [self._keys.invocations(each.robot)]
            ]
        )
        for each, saved in zip(invocations, answers, strict=True):
            if saved:
                self._tell("invocation", each.robot, each.id)
        return [bool(saved) for saved in answers]

    async def delete(self, invocation: Invocation) -> bool:
        """Forget an invocation; False if there was none. Its idempotency key stays used."""
        deleted = await self._redis.run(scripts.DELETE, self._keys.invocations(invocation.robot), invocation.id)
        if deleted:
            self._tell("deleted", invocation.robot, invocation.id)
        return bool(deleted)

    async def read(self, robot: str, id: str) -> Invocation | None:
        body = await self._redis.run(scripts.READ, self._keys.invocations(robot), id)
        return None if body is None else _read(robot, body)

    async def load(self) -> list[Invocation]:
        """All invocations of all robots that are remembered, oldest first."""
        found: list[Invocation] = []
        for name in await self._redis.one("ZRANGE", self._keys.robots, 0, -1):
            robot = robot_of(name.decode())
            bodies = await self._redis.run(scripts.LOAD, self._keys.invocations(robot))
            found += [one for one in (_read(robot, body) for body in bodies) if one is not None]
            if not bodies:
                await self._redis.run(scripts.RETIRE, (self._keys.robots,), name, self._day() - 1)
        return sorted(found, key=lambda invocation: invocation.created_ns)

    # Leases

    async def take(self, robot: str, holder: str, duration_s: float, token: str = "") -> tuple[Lease, str]:
        """Take the lease of a robot from now on, or renew it with its token; the lease, and its token.

        One that was free is a new one with a new token, whatever token was given. LeaseHeld. After StoreUnavailable
        a lease may be held of which nobody knows the token, until it expires.
        """
        id, new_token = str(uuid.uuid4()), uuid.uuid4().urn
        arguments = (_secret(token), id, _secret(new_token), holder, _ms(duration_s))
        answer = await self._redis.run(scripts.TAKE, (self._keys.lease(robot),), *arguments)
        lease = _lease(robot, _granted(robot, answer)[1:])
        self._tell("lease", robot, lease.id)
        return lease, new_token if lease.id == id else token

    async def release(self, robot: str, token: str) -> bool:
        """End a lease; False when there is none. LeaseHeld when the token is not its."""
        answer = await self._redis.run(scripts.RELEASE, (self._keys.lease(robot),), _secret(token))
        said, *lease = _granted(robot, answer)
        if said == b"free":
            return False
        self._tell("lease", robot, _lease(robot, lease).id)
        return True

    async def lease(self, robot: str) -> Lease | None:
        said, *lease = await self._redis.run(scripts.HELD, (self._keys.lease(robot),))
        return None if said == b"free" else _lease(robot, lease)

    # Settings

    async def settings(self, robot: str) -> dict[str, str]:
        """Return the settings of a robot, by name."""
        return _settings(await self._redis.one("HGETALL", self._keys.settings(robot)))

    async def set_setting(self, robot: str, name: str, present: str | None, value: str | None) -> bool:
        """Set something for a robot for good in place of what is ``present``, either of them None for nothing; False,
        and nothing is set, when something else is there."""
        keys = (self._keys.settings(robot), self._keys.configured)
        there = "" if present is None else f"={present}"
        done = await self._redis.run(scripts.SET, keys, tag(robot), name, there, *(() if value is None else (value,)))
        if done:
            self._tell("settings", robot, name)
        return bool(done)

    async def all_settings(self) -> dict[str, dict[str, str]]:
        """Return the settings of all robots, by robot and name."""
        robots = [robot_of(name.decode()) for name in await self._redis.one("SMEMBERS", self._keys.configured)]
        answers = await self._redis.all([("HGETALL", self._keys.settings(robot)) for robot in robots])
        return {robot: _settings(fields) for robot, fields in zip(robots, answers, strict=True) if fields}

    # News

    async def news(self) -> AsyncGenerator[News | None, None]:
        """Yield the changes by other runs since the first contact, for ever; outages are waited out.

        None follows each outage that any method met: there may be more, and what is remembered must be read anew.
        """
        async with aclosing(self._redis.news()) as news:
            async for fields in news:
                if fields is None:
                    yield None
                    continue
                what = fields[b"what"].decode()
                if fields[b"run"].decode() != self._run and what in get_args(What):  # not of a later version
                    yield News(cast(What, what), fields[b"robot"].decode(), fields[b"id"].decode())

    def _tell(self, what: What, robot: str, id: str) -> None:
        """Tell the others as soon as it can be: what was done is done, whether or not they hear of it yet."""
        news = News(what, robot, id)
        self._untold.pop(news, None)
        self._untold[news] = None
        self._to_tell.set()

    async def _tell_others(self) -> None:
        await self._to_tell.wait()
        heed_cancellation()
        self._to_tell.clear()
        await self._tell_rest()

    async def _tell_rest(self) -> None:
        telling, self._untold = self._untold, {}
        if not telling:
            return
        try:
            await self._redis.all([self._entry(news) for news in telling])
        except BaseException:  # cancelled as well
            self._untold = dict.fromkeys(
                [*(each for each in telling if each not in self._untold), *self._untold][-_NEWS:]
            )
            self._to_tell.set()
            raise

    def _entry(self, news: News) -> tuple[str | int, ...]:
        fields = ("what", news.what, "robot", news.robot, "id", news.id, "run", self._run)
        return ("XADD", self._keys.news, "MAXLEN", "~", _NEWS, "*", *fields)

    # Steps

    async def _note(self, robot: str) -> None:
        """First of all, once a day and after an outage: what is not in this set is found by nobody who loads."""
        noted = self._day(), self._redis.outages
        if self._noted.get(robot) != noted:
            await self._redis.one("ZADD", self._keys.robots, "GT", noted[0], tag(robot))
            self._noted[robot] = noted

    def _day(self) -> int:
        """The number of the day, so that a robot is noted once a day and not struck out before the next is over."""
        return int(time.time() / self._kept_s)

    def _written(self, invocation: Invocation) -> tuple[str | bytes | int, ...]:
        """Id, body, milliseconds to keep it, whether it is over for good, creation in microseconds."""
        over = invocation.over
        left_s = 0.0 if over else max(0.0, (invocation.deadline_ns - time.time_ns()) / 1e9)
        body, kept_ms = msgspec.json.encode(invocation), _ms(left_s + self._kept_s)
        return invocation.id, body, kept_ms, int(over), invocation.created_ns // 1000


def _granted(robot: str, answer: list[bytes], lease: str = "") -> list[bytes]:
    """The answer of a script unless it is a refusal: LeaseHeld, LeaseOver."""
    if answer[0] == b"held":
        raise LeaseHeld(_lease(robot, answer[1:]))
    if answer[0] == b"over":
        raise LeaseOver(lease)
    return answer


def _lease(robot: str, fields: Sequence[bytes]) -> Lease:
    id, holder, *numbers = (field.decode() for field in fields)
    taken_ms, expires_ms, duration_ms, left_ms = map(int, numbers)
    return Lease(id, robot, holder, taken_ms * _MS, expires_ms * _MS, duration_ms / 1000, max(0, left_ms) / 1000)


def _read(robot: str, body: bytes) -> Invocation | None:
    """None for what another version has written and this one cannot read."""
    try:
        return msgspec.json.decode(body, type=Invocation)
    except ValueError as error:
        _log.warning("an invocation of %s is left alone, it cannot be read: %r", robot or "the fleet", error)
        return None


def _settings(fields: dict[bytes, bytes]) -> dict[str, str]:
    return {name.decode(): value.decode() for name, value in fields.items()}


def _secret(token: str) -> str:
    """The record of a token in Redis; empty for none, which is nobody's."""
    return hashed(token) if token else ""


def _ms(duration_s: float) -> int:
    return round(duration_s * 1000)
