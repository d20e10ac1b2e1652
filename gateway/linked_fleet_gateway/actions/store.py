"""Invocations, leases and settings of robots in Redis, shared by all gateways.

Each step is executed atomically where the robot's keys are stored, then other gateways are notified. Notifications that
fail during an outage are sent later; listeners learn of each outage and read everything again.
"""

import asyncio
import logging
import time
import uuid
from collections.abc import AsyncGenerator, Collection, Sequence
from contextlib import aclosing
from dataclasses import dataclass
from functools import partial
from itertools import chain, compress
from typing import Literal, Self, cast, get_args

import msgspec

from linked_fleet_gateway.actions import redis_scripts as scripts
from linked_fleet_gateway.actions.owed_stop_table import OwedStopTable
from linked_fleet_gateway.actions.redis_scripts import Keys, robot_from_tag, robot_tag, text_hash
from linked_fleet_runtime.background import cancel_tasks, run_last_step, supervised
from linked_fleet_runtime.redis import GATHER_S, Connection, eval_command, raise_pending_cancellation
from linked_fleet_runtime.redis_exchange import Command
from linked_fleet_state.invocation import Lease, Priority
from linked_fleet_state.invocations import MAX_TERMINAL, Invocation

__all__ = [
    "RETENTION_S",
    "ActionStore",
    "KeyReused",
    "Lease",
    "LeaseHeld",
    "LeaseNotHeld",
    "MotionLimitReached",
    "News",
]
_log = logging.getLogger(__name__)

RETENTION_S = 86_400.0  # for an ended invocation, and for a used idempotency key
_NEWS = 10_000  # entries kept, approximately; also the limit of unsent changes
_TOGETHER = 16  # changes in one entry
_LAST_S = 0.5  # to send the rest when this gateway ends
_MS = 1_000_000  # nanoseconds

NewsKind = Literal["invocation", "deleted", "lease", "settings", "stop", "forgotten"]
_CHANGES = msgspec.json.Decoder(list[tuple[str, str, str]])


@dataclass(frozen=True)
class News:
    """A change by another run; ``id`` is that of the invocation, lease or stop, or the name of the setting."""

    kind: NewsKind
    robot: str = ""
    id: str = ""


class LeaseHeld(Exception):  # noqa: N818
    """Another caller has the lease."""

    def __init__(self, lease: Lease) -> None:
        super().__init__(f"{lease.holder} has the lease of {lease.robot or 'the fleet'}")
        self.lease = lease


class LeaseNotHeld(Exception):  # noqa: N818
    """The lease that an invocation is tied to is not held now."""


class MotionLimitReached(Exception):  # noqa: N818
    """The client has reached its limit of running invocations."""


class KeyReused(Exception):  # noqa: N818
    """The idempotency key was used for another request within the last day."""


class ActionStore:
    """Access of one run of a gateway to the store, as an async context manager; ``run`` is unique to it.

    The robot "" is the fleet as a whole. It opens without contact and reconnects by itself. During an outage every
    method except ``news`` raises RedisUnavailable, and it is unknown if the step was executed. Raises ValueError for an
    invalid URL, namespace or robot name.
    """

    def __init__(self, url: str, namespace: str, run: str, retention_s: float = RETENTION_S) -> None:
        self._keys = Keys(namespace)
        self._run = run
        self._retention_s = retention_s
        self._redis = Connection(url, self._keys.news)
        tell_of_stop = partial(self._tell, "stop")
        self.owed_stops = OwedStopTable(self._redis, self._keys.owed_stops, retention_s, tell_of_stop)
        self._untold: list[News] = []
        """In the order of the changes."""
        self._to_tell = asyncio.Event()
        self._noted: dict[str, tuple[int, int]] = {}
        self._tasks: list[asyncio.Task[None]] = []

    async def __aenter__(self) -> Self:
        failed = "other gateways have not been told"
        self._tasks = [supervised(self._tell_others, "tell other gateways", _log, failed, GATHER_S)]
        return self

    async def __aexit__(self, *_: object) -> None:
        await cancel_tasks(self._tasks)
        await run_last_step(self._tell_rest(), _log, "other gateways have not been told everything", _LAST_S)
        await self._redis.close()

    # Invocations

    async def create(
        self, invocation: Invocation, *, lease_token: str = "", idempotency_key: str = "", request_digest: str = "",
        ignore_lease: bool = False, limit_reached: bool = False,
    ) -> str | None:  # fmt: skip
        """Store a new invocation, or return the id of the earlier one that the same request has created.

        Raises LeaseHeld unless ``lease_token`` is that of the lease, if any; LeaseNotHeld if the invocation is tied to
        a lease that is not held. ``request_digest`` identifies the request of ``idempotency_key``: raises KeyReused if
        the key was used with another one within a day. ``ignore_lease`` admits any caller. ``limit_reached`` says that
        the client has reached its limit: raises Full, unless the request is a repeated one. May be repeated with the
        same invocation after RedisUnavailable.
        """
        robot = invocation.robot
        await self._note(robot)
        keys: tuple[str, ...] = (*self._keys.invocations(robot), self._keys.lease(robot))
        once: tuple[str | int, ...] = ()
        if idempotency_key:
            once = request_digest, _ms(self._retention_s)
            keys += (self._keys.idempotency_key(robot, idempotency_key),)
        rules = scripts.ANYBODY if ignore_lease else _secret(lease_token), invocation.lease
        answer = await self._redis.run_script(
            scripts.OPEN, keys, *rules, *self._written(invocation), MAX_TERMINAL, int(limit_reached), *once
        )
        said, *rest = _granted(robot, answer, invocation.lease)
        if said == b"reused":
            raise KeyReused(idempotency_key)
        if said == b"full":
            raise MotionLimitReached(invocation.client)
        if said == b"repeated":
            return rest[0].decode()
        self._tell("invocation", robot, invocation.id)
        return None

    async def check_lease(self, robot: str, token: str, lease: str = "") -> None:
        """Check the lease like ``create``. Raises LeaseHeld, LeaseNotHeld."""
        answer = await self._redis.run_script(scripts.CHECK, (self._keys.lease(robot),), _secret(token), lease)
        _granted(robot, answer, lease)

    async def save(self, invocation: Invocation) -> bool:
        """Store the state of an invocation. Return False, without a change, if it was deleted or over already.

        May be repeated after RedisUnavailable and then returns True again. Acceptances are notified too, because only
        the gateway that sent the command knows the duration.
        """
        return (await self.save_all([invocation]))[0]

    async def save_all(self, invocations: Sequence[Invocation], new_ids: Collection[str] = ()) -> list[bool]:
        """Do ``save`` for many invocations, in one step for each robot.

        Those with ids in ``new_ids`` are opened if they do not exist, whoever has a lease.
        """
        by_robot: dict[str, list[Invocation]] = {}
        for each in invocations:
            by_robot.setdefault(each.robot, []).append(each)
        for robot in {each.robot for each in invocations if each.id in new_ids}:
            await self._note(robot)
        answers = await self._redis.execute_all(
            [self._saving(robot, held, new_ids) for robot, held in by_robot.items()]
        )
        saved = set[str]()
        for held, answer in zip(by_robot.values(), answers, strict=True):
            for each in compress(held, answer):
                saved.add(each.id)
                self._tell("invocation", each.robot, each.id)
        return [each.id in saved for each in invocations]

    async def delete(self, invocation: Invocation) -> bool:
        """Delete an invocation; return False if there was none. Its idempotency key stays used."""
        deleted = await self._redis.run_script(scripts.DELETE, self._keys.invocations(invocation.robot), invocation.id)
        if deleted:
            self._tell("deleted", invocation.robot, invocation.id)
        return bool(deleted)

    async def read_invocation(self, robot: str, id: str) -> Invocation | None:
        body = await self._redis.run_script(scripts.READ, self._keys.invocations(robot), id)
        return None if body is None else _read(robot, body)

    async def load_invocations(self) -> list[Invocation]:
        """Return all stored invocations of all robots, oldest first."""
        found: list[Invocation] = []
        for name in await self._redis.execute("ZRANGE", self._keys.robots, 0, -1):
            robot = robot_from_tag(name.decode())
            bodies = await self._redis.run_script(scripts.LOAD, self._keys.invocations(robot))
            found += [one for one in (_read(robot, body) for body in bodies) if one is not None]
            if not bodies:
                await self._redis.run_script(scripts.RETIRE, (self._keys.robots,), name, self._day() - 1)
        return sorted(found, key=lambda invocation: invocation.created_ns)

    # Leases

    async def take_lease(
        self, robot: str, holder: str, duration_s: float, token: str = "", priority: Priority | None = None,
        *, own: str = "",
    ) -> tuple[Lease, str]:  # fmt: skip
        """Take the lease of a robot, or renew it with its token. Return the lease and its token.

        A free lease is taken with a new token, or with the token ``own`` of gateways, whatever token was given, and so
        is a program's with the ``priority`` of a person. Raises LeaseHeld. After RedisUnavailable a
        lease may exist whose token nobody knows, until it expires.
        """
        id, new_token = str(uuid.uuid4()), own or uuid.uuid4().urn
        arguments = (_secret(token), id, _secret(new_token), holder, _ms(duration_s), priority or "")
        answer = await self._redis.run_script(scripts.TAKE, (self._keys.lease(robot),), *arguments)
        lease = _lease(robot, _granted(robot, answer)[1:])
        self._tell("lease", robot, lease.id)
        return lease, new_token if lease.id == id else token

    async def hand_over_lease(
        self, robot: str, token: str, new_token: str, holder: str, duration_s: float, *, may_be_person: bool
    ) -> Lease | None:
        """Give the lease of a robot to another holder, in one step; return None if nobody has it. Raises LeaseHeld."""
        id, secrets = str(uuid.uuid4()), (_secret(token), _secret(new_token))
        arguments = (secrets[0], id, secrets[1], holder, _ms(duration_s), int(may_be_person))
        answer = await self._redis.run_script(scripts.HAND_OVER, (self._keys.lease(robot),), *arguments)
        said, *fields = _granted(robot, answer)
        if said == b"free":
            return None
        lease = _lease(robot, fields)
        self._tell("lease", robot, lease.id)
        return lease

    async def release_lease(self, robot: str, token: str) -> bool:
        """Release a lease; return False if there is none. Raises LeaseHeld if the token is wrong."""
        answer = await self._redis.run_script(scripts.RELEASE, (self._keys.lease(robot),), _secret(token))
        said, *lease = _granted(robot, answer)
        if said == b"free":
            return False
        self._tell("lease", robot, _lease(robot, lease).id)
        return True

    async def read_lease(self, robot: str) -> Lease | None:
        said, *lease = await self._redis.run_script(scripts.HELD, (self._keys.lease(robot),))
        return None if said == b"free" else _lease(robot, lease)

    # Settings

    async def read_settings(self, robot: str) -> dict[str, str]:
        """Return the settings of a robot by name."""
        return _settings(await self._redis.execute("HGETALL", self._keys.settings(robot)))

    async def set_setting(self, robot: str, name: str, present: str | None, value: str | None) -> bool:
        """Replace the value ``present`` of a setting by ``value``; None stands for no value.

        Returns False, without a change, if the present value differs.
        """
        keys = (self._keys.settings(robot), self._keys.robots_with_settings)
        there = "" if present is None else f"={present}"
        done = await self._redis.run_script(
            scripts.SET, keys, robot_tag(robot), name, there, *(() if value is None else (value,))
        )
        if done:
            self._tell("settings", robot, name)
        return bool(done)

    async def read_all_settings(self) -> dict[str, dict[str, str]]:
        """Return the settings of all robots, by robot and name."""
        robots = [
            robot_from_tag(name.decode())
            for name in await self._redis.execute("SMEMBERS", self._keys.robots_with_settings)
        ]
        answers = await self._redis.execute_all([("HGETALL", self._keys.settings(robot)) for robot in robots])
        return {robot: _settings(fields) for robot, fields in zip(robots, answers, strict=True) if fields}

    # Robots

    async def forget_robot(self, robot: str) -> None:
        """Delete the settings and the invocations of a robot."""
        tag, keys = robot_tag(robot), self._keys
        commands: list[Command] = [
            ("DEL", keys.settings(robot)),
            ("SREM", keys.robots_with_settings, tag),
            ("DEL", *keys.invocations(robot)),
            ("ZREM", keys.robots, tag),
        ]
        self._noted.pop(robot, None)
        await self._redis.execute_all(commands)
        self._tell("forgotten", robot, "")

    # News

    async def news(self) -> AsyncGenerator[News | None, None]:
        """Yield the changes by other runs since the first contact, for ever; outages are waited out.

        None follows each outage that any method met: changes may be missing, so everything must be read again.
        """
        async with aclosing(self._redis.stream_entries()) as news:
            async for fields in news:
                if fields is None:
                    yield None
                    continue
                if fields.get(b"run") == self._run.encode():
                    continue
                for what, robot, id in _CHANGES.decode(fields.get(b"news", b"[]")):
                    if what in get_args(NewsKind):  # ignores those of later versions
                        yield News(cast(NewsKind, what), robot, id)

    def _tell(self, what: NewsKind, robot: str, id: str) -> None:
        """Notify the other gateways as soon as possible; the change itself does not depend on it."""
        self._untold.append(News(what, robot, id))
        self._to_tell.set()

    async def _tell_others(self) -> None:
        await self._to_tell.wait()
        raise_pending_cancellation()
        self._to_tell.clear()
        await self._tell_rest()

    async def _tell_rest(self) -> None:
        telling, self._untold = self._untold, []
        try:
            parts = range(0, len(telling), _TOGETHER)
            await self._redis.execute_all([self._entry(telling[first : first + _TOGETHER]) for first in parts])
        except BaseException:  # cancelled as well
            self._untold = [*telling, *self._untold][-_NEWS:]
            self._to_tell.set()
            raise

    def _entry(self, changes: Sequence[News]) -> tuple[str | bytes | int, ...]:
        """Return one entry for many changes, because redis-py takes time for each field, at both ends."""
        news = msgspec.json.encode([(each.kind, each.robot, each.id) for each in changes])
        return ("XADD", self._keys.news, "MAXLEN", "~", _NEWS, "*", "run", self._run, "news", news)

    # Steps

    def _saving(self, robot: str, invocations: Sequence[Invocation], new_ids: Collection[str]) -> Command:
        """Return the command that stores invocations of one robot."""
        written = [(*self._written(each), int(each.id in new_ids)) for each in invocations]
        return eval_command(scripts.SAVE, self._keys.invocations(robot), MAX_TERMINAL, *chain.from_iterable(written))

    async def _note(self, robot: str) -> None:
        """Announce a robot, once a day and after an outage: ``load_invocations`` finds only robots in this set."""
        noted = self._day(), self._redis.outage_count
        if self._noted.get(robot) != noted:
            await self._redis.execute("ZADD", self._keys.robots, "GT", noted[0], robot_tag(robot))
            self._noted[robot] = noted

    def _day(self) -> int:
        """Return the number of the day. A robot is announced once a day and not removed before the next day is over."""
        return int(time.time() / self._retention_s)

    def _written(self, invocation: Invocation) -> tuple[str | bytes | int, ...]:
        """Return id, body, milliseconds to keep it, 1 if it is over for good, and creation in microseconds."""
        over = invocation.is_final
        left_s = 0.0 if over else max(0.0, (invocation.deadline_ns - time.time_ns()) / 1e9)
        body, kept_ms = msgspec.json.encode(invocation), _ms(left_s + self._retention_s)
        return invocation.id, body, kept_ms, int(over), invocation.created_ns // 1000


def _granted(robot: str, answer: list[bytes], lease: str = "") -> list[bytes]:
    """Return a script's answer. Raises LeaseHeld, LeaseNotHeld for refusals."""
    if answer[0] == b"held":
        raise LeaseHeld(_lease(robot, answer[1:]))
    if answer[0] == b"over":
        raise LeaseNotHeld(lease)
    return answer


def _lease(robot: str, fields: Sequence[bytes]) -> Lease:
    id, holder, *numbers, said = (field.decode() for field in fields)
    taken_ms, expires_ms, duration_ms, left_ms = map(int, numbers)
    left_s = max(0, left_ms) / 1000
    priority: Priority = "person" if said == "person" else "program"
    return Lease(id, robot, holder, taken_ms * _MS, expires_ms * _MS, duration_ms / 1000, left_s, priority)


def _read(robot: str, body: bytes) -> Invocation | None:
    """Return an invocation; None if another version wrote it in an unreadable form."""
    try:
        return msgspec.json.decode(body, type=Invocation)
    except ValueError as error:
        _log.warning("an invocation of %s is left alone, it cannot be read: %r", robot or "the fleet", error)
        return None


def _settings(fields: dict[bytes, bytes]) -> dict[str, str]:
    return {name.decode(): value.decode() for name, value in fields.items()}


def _secret(token: str) -> str:
    """Return the stored form of a token; empty for none, which matches no lease."""
    if token.startswith(_KEPT):
        return token.removeprefix(_KEPT)
    return text_hash(token) if token else ""


_KEPT = "kept:"  # no client can send it: tokens are URNs


def own_token() -> str:
    """Return the token of a lease that gateways take for themselves."""
    return kept_token(uuid.uuid4().urn)


def kept_token(token: str) -> str:
    """Return what may be kept of a token: within gateways it proves the lease, and a client cannot use it."""
    return token and _KEPT + _secret(token)


def _ms(duration_s: float) -> int:
    return round(duration_s * 1000)
