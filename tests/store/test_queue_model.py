"""The queue of callbacks against a model: whatever gateways do, nothing is lost or doubled.

Gateways add, change, deliver, acknowledge, leave, crash between two steps of an operation, and take over.
"""

import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, initialize, invariant, precondition, rule

from linked_fleet_base.errors import RedisUnavailable
from linked_fleet_gateway.resources.subscription import Delivery, DeliveryState, Kind, Subscription
from linked_fleet_gateway.subscriptions.records import read_entry
from linked_fleet_gateway.subscriptions.redis_scripts import Keys
from linked_fleet_gateway.subscriptions.store import (
    Backlog,
    OutgoingMessage,
    QueueEntry,
    SubscriptionNotHeld,
    SubscriptionStore,
)
from redis_backends import Backend, Memory, hold_to
from store_samples import LEASE_S, LIMIT, CrashedError, a_subscription, adopted, crash_after, held, listed

OWNER = "/baxter/right_s1"
WAITING = Delivery(DeliveryState.WAITING)
PATHS = st.sampled_from(["/a", "/b", "/c"])
WHICH = st.integers(0, 5)


@dataclass
class Kept:
    """The expected state of one subscription in Redis."""

    subscription: Subscription
    holder: str
    delivery: Delivery
    number: int = 0
    anew: int = 0
    queue: list[QueueEntry] = field(default_factory=list)
    sent: dict[str, str] = field(default_factory=dict)

    @property
    def streams(self) -> bool:
        return self.subscription.kind.is_stream

    @property
    def lasts(self) -> bool:
        return not self.streams or self.delivery.state is DeliveryState.WAITING


class CallbackQueue(RuleBasedStateMachine):
    """``living``: gateways. ``dead``: runs that crashed or left, and hold what nobody has adopted yet.

    ``leased``: those of them that died too recently for anybody to know.
    """

    ids = Bundle("ids")

    def __init__(self, server: Backend) -> None:
        super().__init__()
        server.empty()
        self.server, self.run = server, server.run
        self.observer = SubscriptionStore(server.url, "fleet", "observer", LEASE_S)
        self.living: list[SubscriptionStore] = []
        self.dead: set[str] = set()
        self.leased: set[str] = set()
        self.kept: dict[str, Kept] = {}
        self.count = 0

    def gateway(self, which: int) -> SubscriptionStore:
        return self.living[which % len(self.living)]

    def teardown(self) -> None:
        """Remove everything; then nothing may be left of what any gateway began."""
        self.take_over(0, 0)
        for id in self.kept:
            self.run(self.living[0].remove(id))
        for store in self.living:
            self.run(store.announce_end())
        left = set(self.server.lasting_keys()) - {Keys().news}
        for store in (*self.living, self.observer):
            self.run(store.__aexit__())
        assert left == set()

    # -- gateways -----------------------------------------------------------------------------------------------------

    @initialize()
    def begin(self) -> None:
        for _ in range(2):
            self.start()

    @precondition(lambda self: len(self.living) < 4)
    @rule()
    def start(self) -> None:
        self.count += 1
        self.living.append(SubscriptionStore(self.server.url, "fleet", f"run-{self.count}", LEASE_S))
        self.run(self.living[-1].renew_lease())

    def die(self, store: SubscriptionStore) -> None:
        self.run(store.__aexit__())
        self.living.remove(store)
        self.dead.add(store._run)
        self.leased.add(store._run)
        if not self.living:
            self.start()

    @rule(which=WHICH, leaves=st.booleans())
    def end(self, which: int, leaves: bool) -> None:
        store = self.gateway(which)
        if leaves:
            self.run(store.announce_end())
        self.die(store)
        self.leased -= {store._run} if leaves else set()

    def pass_a_lease(self) -> None:
        self.server.pass_time(LEASE_S + 1)
        self.leased.clear()
        for store in self.living:
            self.run(store.renew_lease())

    @rule(which=WHICH, other=WHICH)
    def take_over(self, which: int, other: int) -> None:
        """The leases of the dead expire, and two gateways take over at once."""
        self.pass_a_lease()
        taker, rival = self.gateway(which), self.gateway(other)
        found = set(self.run(taker.dead_runs()))
        orphans = {id: one for id, one in self.kept.items() if one.holder in self.dead}
        assert {one.holder for one in orphans.values()} <= found <= self.dead
        won = []
        for run in sorted(found):
            for store, part in zip(
                (taker, rival), self.run(_both(adopted(taker, run), adopted(rival, run))), strict=True
            ):
                for one in part:
                    self.kept[one.id].holder = store._run
                    won.append(one.id)
        assert sorted(won) == sorted(id for id, one in orphans.items() if one.lasts)  # each once
        self.kept = {id: one for id, one in self.kept.items() if id not in orphans or one.lasts}
        assert self.run(taker.dead_runs()) == []
        self.dead.clear()

    # -- subscriptions ------------------------------------------------------------------------------------------------

    @rule(target=ids, which=WHICH, kind=st.sampled_from([Kind.CALLBACK, Kind.CALLBACK, Kind.STREAM, Kind.WEBSOCKET]))
    def add(self, which: int, kind: Kind) -> str:
        store, one = self.gateway(which), a_subscription(kind=kind, owner=OWNER)
        delivery = WAITING if kind is Kind.STREAM else Delivery()
        self.run(store.add(one, delivery, LIMIT))
        self.kept[one.id] = Kept(one, store._run, delivery)
        return one.id

    @rule(id=ids, which=WHICH, failures=st.integers(0, 3))
    def add_again(self, id: str, which: int, failures: int) -> None:
        """A callback stays with its gateway, and a stream goes to the one that opens it."""
        store, one = self.gateway(which), self.kept.get(id)
        if one is None:
            return
        delivery = replace(one.delivery, failures=failures)
        self.run(store.add(one.subscription, delivery, LIMIT))
        if one.streams or one.holder == store._run:
            one.holder, one.delivery = store._run, delivery

    @rule(id=ids, which=WHICH, own=st.booleans())
    def remove(self, id: str, which: int, own: bool) -> None:
        store, one = self.gateway(which), self.kept.get(id)
        removed = self.run(store.remove(id, only_if_held=own))
        if one is None or (own and one.holder != store._run):
            assert removed is None
        else:
            assert removed is not None and removed.subscription == one.subscription
            del self.kept[id]

    @rule(id=ids, which=WHICH, last_ns=st.integers(0, 9))
    def note(self, id: str, which: int, last_ns: int) -> None:
        store, one = self.gateway(which), self.kept.get(id)
        state = WAITING if one is None else one.delivery
        lost = self.run(store.store_delivery_states({id: replace(state, last_ns=last_ns)}))
        if one is None or one.holder != store._run:
            assert lost == {id}
        else:
            assert lost == set()
            one.delivery = replace(state, last_ns=last_ns)

    # -- deliveries ---------------------------------------------------------------------------------------------------

    @rule(
        id=ids, which=WHICH, path=st.none() | PATHS, done=st.none() | WHICH, forget=st.lists(PATHS, max_size=2),
        wanted=st.sampled_from([None, 0, 0, 1]), late=st.sampled_from([0, 0, 1]),
    )  # fmt: skip
    def advance(
        self, id: str, which: int, path: str | None, done: int | None, forget: list[str], wanted: int | None, late: int
    ) -> None:
        """Acknowledge an entry, queue another, or both; the latter possibly rendered for former options."""
        store, one = self.gateway(which), self.kept.get(id)
        entry, outgoing, delivery = self.step(one, path, done, late)
        number = None if wanted is None or one is None else one.number + 1 + wanted
        if one is None or one.holder != store._run:
            for work in (store.advance_queue(id, entry, outgoing, delivery, forget, number), store.read_backlog(id)):
                with pytest.raises(SubscriptionNotHeld):
                    self.run(work)
        elif not one.streams:
            queued = self.run(store.advance_queue(id, entry, outgoing, delivery, forget, number))
            if wanted == 1 and outgoing is not None:
                assert queued is None  # another number, so nothing is done
            else:
                self.taken(one, entry, outgoing, delivery, forget, queued)

    @rule(id=ids, which=WHICH, media_type=st.sampled_from(["text/turtle", "application/ld+json"]), late=st.booleans())
    def change(self, id: str, which: int, media_type: str, late: bool) -> None:
        """With another media type the whole state is sent again. A change based on old options is refused."""
        store, one = self.gateway(which), self.kept.get(id)
        read = a_subscription(id=id) if one is None else one.subscription
        before = replace(read, revision=read.revision - late)
        options = replace(before.options, media_type=media_type, interval_s=before.interval_s + 1)
        assert self.run(store.change_options(before, options)) is (one is not None and not late)
        if one is not None and not late:
            one.subscription = read.with_options(options, read.revision + 1)
            if options.needs_full_state(read.options):
                one.anew = read.revision + 1
                one.sent.clear()

    def step(
        self, one: Kept | None, path: str | None, done: int | None, late: int = 0
    ) -> tuple[Any, OutgoingMessage | None, Delivery]:
        number, revision = (one.number, one.subscription.revision) if one is not None else (0, 0)
        queue = one.queue if one is not None else []
        entry = queue[done % len(queue)] if queue and done is not None else None
        body = b"%d" % number * 3
        outgoing = (
            None if path is None else OutgoingMessage(path, f"v{number}", "text/turtle", body, max(0, revision - late))
        )
        return entry, outgoing, Delivery(last_status=200 + (done or 0))

    def taken(
        self, one: Kept, entry: QueueEntry | None, outgoing: OutgoingMessage | None, delivery: Delivery,
        forget: list[str], queued: QueueEntry | None,
    ) -> None:  # fmt: skip
        """Record an executed step in the model."""
        one.delivery = delivery
        one.queue = [each for each in one.queue if each != entry]
        if outgoing is None:
            assert queued is None
        else:
            assert queued is not None
            one.number += 1
            said = outgoing.path, outgoing.version, outgoing.media_type, outgoing.body
            assert queued == QueueEntry(queued.entry_id, one.number, *said)
            one.queue.append(queued)
            if outgoing.revision >= one.anew:
                one.sent[outgoing.path] = outgoing.version
        for path in forget:
            one.sent.pop(path, None)

    # -- what goes wrong in the middle --------------------------------------------------------------------------------

    def interrupted(
        self, store: SubscriptionStore, steps: int, crashes: bool, work: Callable[[], Coroutine[Any, Any, object]]
    ) -> None:
        """Begin an operation, and crash after so many commands or get no answer to the last of them."""
        if crashes or not isinstance(self.server, Memory):
            crash_after(store, steps)
            with suppress(CrashedError):
                self.run(work())
            self.die(store)
        else:
            self.server.redis.fail_after_executing(steps + 1)
            with suppress(RedisUnavailable):
                self.run(work())
            self.server.redis.fail_after_executing(0)

    @rule(target=ids, which=WHICH, steps=st.integers(0, 5), crashes=st.booleans())
    def interrupted_add(self, which: int, steps: int, crashes: bool) -> str:
        """Accepted or not, and invisible if not."""
        store, one = self.gateway(which), a_subscription(owner=OWNER)
        self.interrupted(store, steps, crashes, lambda: store.add(one, Delivery(), LIMIT))
        if self.run(self.observer.get_record(one.id)) is not None:
            self.kept[one.id] = Kept(one, store._run, Delivery())
        return one.id

    @rule(id=ids, which=WHICH, steps=st.integers(0, 5), crashes=st.booleans())
    def interrupted_remove(self, id: str, which: int, steps: int, crashes: bool) -> None:
        store = self.gateway(which)
        self.interrupted(store, steps, crashes, lambda: store.remove(id))
        if self.run(self.observer.get_record(id)) is None:
            self.kept.pop(id, None)

    @rule(id=ids, which=WHICH, steps=st.integers(0, 1), crashes=st.booleans(), path=PATHS, done=st.none() | WHICH)
    def interrupted_advance(self, id: str, which: int, steps: int, crashes: bool, path: str, done: int | None) -> None:
        """Executed as a whole or not at all."""
        store, one = self.gateway(which), self.kept.get(id)
        if one is None or one.holder != store._run or one.streams:
            return
        entry, outgoing, delivery = self.step(one, path, done)
        self.interrupted(store, steps, crashes, lambda: store.advance_queue(id, entry, outgoing, delivery))
        # Neither the length of the queue nor the delivery need differ: one entry may be taken off for the other.
        queued = self.run(self.last_entry(id))
        if queued is not None and queued not in one.queue:
            self.taken(one, entry, outgoing, delivery, [], queued)

    async def last_entry(self, id: str) -> QueueEntry | None:
        script = "return redis.call('XREVRANGE', KEYS[1], '+', '-', 'COUNT', 1)[1]"
        found = await self.observer._redis.run_script(script, (Keys().queue(id),))
        return None if found is None else read_entry(*found)

    @rule(which=WHICH, steps=st.integers(0, 12))
    def interrupted_adoption(self, which: int, steps: int) -> None:
        """Each subscription belongs to the dead run or to the second one that died, or is a stream that has ended."""
        self.pass_a_lease()
        store, before = self.gateway(which), set(self.dead)

        async def adopt() -> None:
            for run in sorted(before):
                await adopted(store, run)

        self.interrupted(store, steps, True, adopt)
        for id, one in [*self.kept.items()]:
            record = self.run(self.observer.get_record(id))
            if record is None:
                assert one.holder in before and not one.lasts
                del self.kept[id]
            elif record.holder != one.holder:
                assert one.holder in before and one.lasts and record.holder == store._run
                one.holder = store._run

    # -- what must hold -----------------------------------------------------------------------------------------------

    @invariant()
    def redis_knows_what_the_model_knows(self) -> None:
        living = {store._run: store for store in self.living}
        leased = self.leased | living.keys()
        shown = [one.subscription for one in self.kept.values() if not one.streams or one.holder in leased]
        assert self.run(listed(self.observer, OWNER)) == shown
        for id, one in self.kept.items():
            record = self.run(self.observer.get_record(id))
            assert record is not None
            assert (record.subscription, record.holder, record.delivery) == (one.subscription, one.holder, one.delivery)
            if one.holder in living and not one.streams:
                assert self.run(living[one.holder].read_backlog(id)) == Backlog(one.queue, one.sent, one.number)
        for run, store in living.items():
            mine = sorted(one.subscription.id for one in self.kept.values() if one.holder == run)
            assert sorted(one.id for one in self.run(held(store))) == mine


async def _both(*work: Awaitable[Any]) -> list[Any]:
    return await asyncio.gather(*work)


def test_no_delivery_is_lost_or_doubled(server: Backend) -> None:
    hold_to(CallbackQueue, server, 25)
