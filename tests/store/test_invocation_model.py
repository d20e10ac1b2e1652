"""Invocations, idempotency keys and leases against a model: all gateways agree, also for repeated requests."""

import asyncio
import time
from collections import defaultdict
from collections.abc import Awaitable, Callable, Coroutine, Iterable, Iterator
from contextlib import nullcontext, suppress
from dataclasses import dataclass, field, replace
from typing import Any

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, MultipleResults, RuleBasedStateMachine, invariant, multiple, precondition, rule

from linked_fleet_base.errors import RedisUnavailable
from linked_fleet_gateway.actions import store as store_module
from linked_fleet_gateway.actions.redis_scripts import Keys
from linked_fleet_gateway.actions.store import (
    ActionStore,
    KeyReused,
    Lease,
    LeaseHeld,
    LeaseNotHeld,
    MotionLimitReached,
)
from linked_fleet_state.invocations import FLEET, Invocation, InvocationState
from redis_backends import Backend, Memory, hold_to
from store_samples import an_invocation, served

KEPT = 3
_S, _LOOK_S, _COUNTED_S = 10**9, 2.0, 2.5
ROBOTS, TOKENS = st.sampled_from(["r", FLEET]), st.sampled_from(["right", "right", "right", "", "wrong"])
OTHER = "k{}\r\n" + "x" * 9000  # a key may be any text
KEYS, USED, DIGESTS = (
    st.sampled_from(["", "", "k", "k", OTHER]),
    st.sampled_from(["k", OTHER]),
    st.sampled_from(["d", "d", "e"]),
)
STATES = st.sampled_from(list(InvocationState))
GATEWAYS = st.integers(0, 1)


@dataclass
class Control:
    """A lease, its token, and the monotonic time of its expiry."""

    lease: Lease
    token: str
    expires_s: float


@dataclass
class Robot:
    """The expected state of one robot in Redis. A key stands for the id and the digest of a request."""

    invocations: dict[str, Invocation] = field(default_factory=dict)
    keys: dict[str, tuple[str, str]] = field(default_factory=dict)
    control: Control | None = None

    def refusal(self, token: str, tied: str) -> type[Exception] | None:
        if self.control is not None and token != self.control.token:
            return LeaseHeld
        if tied and (self.control is None or self.control.lease.id != tied):
            return LeaseNotHeld
        return None

    def put(self, one: Invocation) -> None:
        """Add a new one. The oldest ended one makes room, or the open one with the earliest deadline."""
        self.invocations[one.id] = one
        while len(self.invocations) > KEPT:
            over = [each for each in self.invocations.values() if each.is_final]
            oldest = min(over, key=lambda each: each.created_ns) if over else None
            del self.invocations[(oldest or min(self.invocations.values(), key=lambda each: each.deadline_ns)).id]


class Invocations(RuleBasedStateMachine):
    """Two gateways that share a Redis."""

    ids = Bundle("ids")
    robots: defaultdict[str, Robot]

    def __init__(self, server: Backend) -> None:
        super().__init__()
        server.empty()
        self.server, self.run = server, server.run
        self.stores = [ActionStore(server.url, "fleet", run) for run in ("a", "b")]
        for store in self.stores:
            self.run(store.__aenter__())
        self.robots = defaultdict(Robot)
        self.begun_ns = time.time_ns()
        self.count = 0

    def teardown(self) -> None:
        for store in self.stores:
            self.run(store.__aexit__())

    def token(self, robot: str, which: str) -> str:
        control = self.robots[robot].control
        return control.token if which == "right" and control is not None else which

    def new(self, robot: str, state: InvocationState, tied: str) -> Invocation:
        """Each is a second younger than the one before, and may take an hour."""
        self.count += 1
        created_ns = self.begun_ns + self.count * _S
        return an_invocation(
            robot=robot, state=state, lease=tied, created_ns=created_ns, deadline_ns=created_ns + 3600 * _S
        )

    # -- invocations and idempotency keys -----------------------------------------------------------------------------

    @rule(
        target=ids, which=GATEWAYS, robot=ROBOTS, state=STATES, key=KEYS, digest=DIGESTS, token=TOKENS,
        tied=st.sampled_from(["", "", "held", "gone"]), full=st.integers(0, 5), unasked=st.booleans(),
        lost=st.booleans(),
    )  # fmt: skip
    def open(
        self, which: int, robot: str, state: InvocationState, key: str, digest: str, token: str, tied: str, full: int,
        unasked: bool, lost: bool,
    ) -> tuple[str, str]:  # fmt: skip
        known, token = self.robots[robot], self.token(robot, token)
        lease = known.control.lease.id if tied == "held" and known.control is not None else tied
        one = self.new(robot, state, lease)
        ask = lambda: self.stores[which].create(  # noqa: E731
            one,
            lease_token=token,
            idempotency_key=key,
            request_digest=digest,
            ignore_lease=unasked,
            limit_reached=not full,
        )
        refusal = known.refusal(token, lease)
        with nullcontext() if refusal is None else pytest.raises(refusal):
            self.run(self.stores[which].check_lease(robot, token, lease))
        refusal = None if unasked else refusal
        if refusal is None and key in known.keys and known.keys[key][1] != digest:
            refusal = KeyReused
        if refusal is None and key not in known.keys and not full:
            refusal = MotionLimitReached
        if refusal is not None:
            with pytest.raises(refusal):
                self.run(ask())
        elif key in known.keys:
            assert self.run(ask()) == known.keys[key][0]
        else:
            self.lose(lost, ask)
            assert self.run(ask()) is None
            known.put(one)
            if key:
                known.keys[key] = one.id, digest
        return robot, one.id

    @rule(named=ids, which=GATEWAYS)
    def open_again(self, named: tuple[str, str], which: int) -> None:
        """A repeated request gets the response, possibly of an ended invocation; nothing changes."""
        robot, id = named
        if (one := self.robots[robot].invocations.get(id)) is not None:
            asked = replace(one, state=InvocationState.ACCEPTED, expired=False, progress=0.0)
            assert self.run(self.stores[which].create(asked, ignore_lease=True)) is None

    @rule(
        target=ids, robot=ROBOTS, key=st.sampled_from(["k", OTHER]), digests=st.lists(DIGESTS, min_size=2, max_size=4)
    )
    def open_at_once(self, robot: str, key: str, digests: list[str]) -> tuple[str, str]:
        """One request with a key is executed, repetitions get that invocation, and different requests are refused."""
        known, asked = self.robots[robot], [self.new(robot, InvocationState.ACCEPTED, "") for _ in digests]
        work = [
            self.stores[number % 2].create(one, ignore_lease=True, idempotency_key=key, request_digest=digest)
            for number, (one, digest) in enumerate(zip(asked, digests, strict=True))
        ]
        answers = self.run(_all(work))
        if key not in known.keys:
            first = answers.index(None)
            known.put(asked[first])
            known.keys[key] = asked[first].id, digests[first]
        id, chosen = known.keys[key]
        for one, digest, answer in zip(asked, digests, answers, strict=True):
            if digest == chosen:
                assert answer == (None if one.id == id else id)
            else:
                assert isinstance(answer, KeyReused)
        return robot, id

    @rule(
        named=ids, which=GATEWAYS, state=STATES, expired=st.booleans(), progress=st.integers(0, 9), lost=st.booleans()
    )
    def save(
        self, named: tuple[str, str], which: int, state: InvocationState, expired: bool, progress: int, lost: bool
    ) -> None:
        """The first end is final, unless it was a guess."""
        robot, id = named
        held = self.robots[robot].invocations.get(id)
        written = replace(
            held or an_invocation(id=id, robot=robot), state=state, expired=expired, progress=progress / 10
        )
        ask = lambda: self.stores[which].save(written)  # noqa: E731
        taken = held is not None and (not held.is_final or held == written)
        self.lose(lost, ask)
        assert self.run(ask()) is taken
        if taken:
            self.robots[robot].invocations[id] = written

    @rule(target=ids, which=GATEWAYS, robot=ROBOTS, states=st.lists(STATES, min_size=1, max_size=3))
    def save_new(self, which: int, robot: str, states: list[InvocationState]) -> MultipleResults[tuple[str, str]]:
        """Stops are opened when they are saved, whoever has the lease, in one step with other changes of the robot."""
        known = self.robots[robot]
        changed = [replace(one, progress=0.5) for one in known.invocations.values() if not one.is_final][:1]
        gone, new = an_invocation(robot=robot), [self.new(robot, state, "") for state in states]
        saved = self.run(self.stores[which].save_all([*changed, gone, *new], {one.id for one in new}))
        assert saved == [*(True for _ in changed), False, *(True for _ in new)]
        known.invocations.update((one.id, one) for one in changed)
        for one in new:
            known.put(one)
        return multiple(*((robot, one.id) for one in new))

    @rule(robot=ROBOTS, ends=st.permutations([InvocationState.SUCCEEDED, InvocationState.CANCELLED]))
    def end_at_both(self, robot: str, ends: list[InvocationState]) -> None:
        """One of two simultaneous ends counts."""
        known = self.robots[robot]
        for one in [each for each in known.invocations.values() if not each.is_final][:1]:
            written = [replace(one, state=state, expired=False) for state in ends]
            saved = self.run(_all(store.save(end) for store, end in zip(self.stores, written, strict=True)))
            assert sorted(saved) == [False, True]
            known.invocations[one.id] = written[saved.index(True)]

    @rule(named=ids, which=GATEWAYS)
    def delete(self, named: tuple[str, str], which: int) -> None:
        """Its key stays used."""
        robot, id = named
        deleted = self.run(self.stores[which].delete(an_invocation(id=id, robot=robot)))
        assert deleted is (self.robots[robot].invocations.pop(id, None) is not None)

    # -- leases -------------------------------------------------------------------------------------------------------

    @rule(which=GATEWAYS, robot=ROBOTS, token=TOKENS, duration_s=st.sampled_from([30.25, 90.25]))
    def take(self, which: int, robot: str, token: str, duration_s: float) -> None:
        known, token = self.robots[robot], self.token(robot, token)
        if known.refusal(token, "") is not None:
            with pytest.raises(LeaseHeld):
                self.run(self.stores[which].take_lease(robot, "Ada", duration_s, token))
            return
        lease, given = self.run(self.stores[which].take_lease(robot, "Ada", duration_s, token))
        if known.control is not None:
            assert (lease.id, given) == (known.control.lease.id, known.control.token)
        else:
            assert given != token
        known.control = Control(lease, given, time.monotonic() + duration_s)

    @rule(which=GATEWAYS, robot=ROBOTS, token=TOKENS)
    def release(self, which: int, robot: str, token: str) -> None:
        known, token = self.robots[robot], self.token(robot, token)
        if known.refusal(token, "") is not None:
            with pytest.raises(LeaseHeld):
                self.run(self.stores[which].release_lease(robot, token))
        else:
            assert self.run(self.stores[which].release_lease(robot, token)) is (known.control is not None)
            known.control = None

    # -- time and faults, which only the server in memory has at hand -------------------------------------------------

    @property
    def in_memory(self) -> bool:
        return isinstance(self.server, Memory)

    def lose(self, lost: bool, ask: Callable[[], Coroutine[Any, Any, object]]) -> None:
        """Ask without hearing the answer; a repetition must have the same result."""
        if lost and isinstance(self.server, Memory):
            self.server.redis.fail_after_executing(containing="EVAL")
            with pytest.raises(RedisUnavailable):
                self.run(ask())

    @precondition(lambda self: self.in_memory)
    @rule(passing_s=st.integers(1, 40), watched=st.booleans())
    def let_time_pass(self, passing_s: int, watched: bool) -> None:
        """Gateways watch leases meanwhile; without that leases stand still, except at first."""
        for begun_s in range(0, passing_s, 2) if watched else ():
            self.server.pass_time(min(_LOOK_S, passing_s - begun_s))
            for robot in self.robots:
                self.run(self.stores[0].read_lease(robot))
        if not watched:
            self.server.pass_time(passing_s)
        for known in self.robots.values():
            if known.control is not None and not watched:
                known.control.expires_s += max(0.0, passing_s - _COUNTED_S)
            if known.control is not None and known.control.expires_s <= time.monotonic():
                known.control = None

    @precondition(lambda self: self.in_memory)
    @rule(days=st.just(3))
    def let_days_pass(self, days: int) -> None:
        """Ended and overdue invocations are forgotten, and so are keys and leases."""
        self.server.pass_time(86_400.0 * days)
        self.robots.clear()
        self.begun_ns = time.time_ns()
        assert set(self.server.lasting_keys()) <= {Keys().news, Keys().robots}

    @precondition(lambda self: self.in_memory)
    @rule()
    def restart(self) -> None:
        self.server.kill()
        for store in self.stores:
            with suppress(RedisUnavailable):
                self.run(store.load_invocations())
        self.server.start()
        for store in self.stores:
            self.run(served(store.load_invocations))

    # -- what must hold -----------------------------------------------------------------------------------------------

    @invariant()
    def redis_knows_what_the_model_knows(self) -> None:
        all_known = [one for known in self.robots.values() for one in known.invocations.values()]
        assert self.run(self.stores[1].load_invocations()) == sorted(all_known, key=lambda one: one.created_ns)
        for robot, known in self.robots.items():
            lease = self.run(self.stores[0].read_lease(robot))
            if known.control is None:
                assert lease is None
            else:
                assert lease is not None and lease.id == known.control.lease.id
                assert lease.left_s == pytest.approx(
                    known.control.expires_s - time.monotonic(), abs=0.2 if self.in_memory else 20
                )


async def _all(work: Iterable[Awaitable[Any]]) -> list[Any]:
    return await asyncio.gather(*work, return_exceptions=True)


@pytest.fixture(autouse=True)
def few_are_kept(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(store_module, "MAX_TERMINAL", KEPT)
    yield


def test_gateways_agree_on_invocations_keys_and_leases(server: Backend) -> None:
    hold_to(Invocations, server, 30)
