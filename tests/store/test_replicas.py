"""Callbacks on servers with replicas: only what a replica has as well is accepted."""

import asyncio
from collections.abc import Iterator
from typing import Any

import pytest

from linked_fleet_base.errors import RedisUnavailable
from linked_fleet_gateway.resources.subscription import Delivery, Kind
from linked_fleet_gateway.subscriptions.redis_scripts import Keys
from linked_fleet_gateway.subscriptions.store import SubscriptionStore
from redis_backends import Memory, Real, opened
from redis_servers import Server, Servers, cluster_replicated, single_replicated
from running import eventually
from store_samples import LIMIT, a_subscription, held, listed
from virtual.loop import virtual_time

KEYS = Keys()
OWNER = "/baxter/right_s1"


class ReplicatedMemory(Memory):
    def pause(self) -> None:
        """Stop the replicas: their masters still count them."""
        self.redis.lagging = 1

    def resume(self) -> None:
        self.redis.replicas, self.redis.lagging = 1, 0

    def lose(self) -> None:
        """Make the masters notice that they have no replica any more."""
        self.redis.replicas = 0


class Replicated(Real):
    def __init__(self, servers: Servers, runner: asyncio.Runner) -> None:
        super().__init__(servers, runner)
        self.nodes, self.replicas = servers.nodes, servers.replicas

    def has(self, key: str) -> bool:
        """Return True if a replica has the key."""
        return any(replica.has(key) for replica in self.replicas)

    def pause(self) -> None:
        for replica in self.replicas:
            replica.pause()

    def resume(self) -> None:
        for replica in self.replicas:
            replica.resume()
        self._servers.await_replicas()

    def lose(self) -> None:
        for replica in self.replicas:
            replica.kill()
        for node in self.nodes:
            eventually(lambda node=node: "state=online" not in node.ask("INFO replication"), "it is missed")


@pytest.fixture(scope="module")
def one_master(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Servers]:
    with single_replicated(tmp_path_factory.mktemp("redis")) as running:
        yield running


@pytest.fixture(scope="module")
def masters(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Servers]:
    with cluster_replicated(tmp_path_factory.mktemp("redis")) as running:
        yield running


REAL = [pytest.param(name, marks=pytest.mark.test_all) for name in ("one_master", "masters")]


@pytest.fixture(params=["memory", *REAL])
def server(request: pytest.FixtureRequest) -> Iterator[ReplicatedMemory | Replicated]:
    if request.param == "memory":
        with virtual_time() as loop:
            memory = ReplicatedMemory(loop)
            memory.resume()
            yield memory
    else:
        with asyncio.Runner() as runner:
            yield Replicated(request.getfixturevalue(request.param), runner)


@pytest.fixture
def a(server: ReplicatedMemory | Replicated) -> Iterator[SubscriptionStore]:
    yield from opened(server, SubscriptionStore(server.url, "fleet", "a"))


@pytest.mark.parametrize("server", REAL, indirect=True)
async def test_accepted_callbacks_are_on_a_replica(server: Replicated, a: SubscriptionStore) -> None:
    for _ in range(30):
        one = a_subscription()
        await a.add(one, Delivery(), LIMIT)
        assert server.has(KEYS.record(one.id))
        assert server.has(KEYS.queue(one.id))


async def test_an_unconfirmed_callback_is_refused_and_removed(
    server: ReplicatedMemory | Replicated, a: SubscriptionStore
) -> None:
    before = [a_subscription() for _ in range(9)]  # connections whose earlier writes are confirmed
    await asyncio.gather(*(a.add(one, Delivery(), LIMIT) for one in before))
    server.pause()
    try:
        refused = [a_subscription() for _ in range(9)]
        results = await asyncio.gather(*(a.add(one, Delivery(), LIMIT) for one in refused), return_exceptions=True)
        assert {type(result) for result in results} == {RedisUnavailable}, results
        for one, result in zip(refused, results, strict=True):
            assert result.cause == f"no replica of Redis confirmed subscription {one.id} in time"
        stream = a_subscription(kind=Kind.WEBSOCKET)
        await a.renew_lease()
        await a.add(stream, Delivery(), LIMIT)
        assert await listed(a) == [*before, stream]
        assert {one.id for one in await held(a)} == {stream.id, *(one.id for one in before)}
        for one in (stream, *before):
            await a.remove(one.id)
        await a.announce_end()
        assert server.lasting_keys() == []
    finally:
        server.resume()
    one = a_subscription()
    await until_added(a, one)
    assert await listed(a) == [one]
    if isinstance(server, Replicated):
        assert server.has(KEYS.record(one.id))
        assert not any(server.has(KEYS.record(each.id)) for each in refused)


async def until_added(store: SubscriptionStore, subscription: Any) -> None:
    """The replicas may still be reading what arrived while they were stopped."""
    for _ in range(20):
        try:
            return await store.add(subscription, Delivery(), LIMIT)
        except RedisUnavailable:
            continue
    pytest.fail("no replica confirms")


async def test_a_subscription_that_vanishes_before_it_is_confirmed_is_not_accepted(
    server: ReplicatedMemory | Replicated, a: SubscriptionStore
) -> None:
    """A failover to a replica that did not have it yet causes this."""
    one, ask = a_subscription(), a._redis.run_replicated_script

    async def late(script: str, key: str, *arguments: str) -> Any:
        await a._redis.execute("DEL", key)
        return await ask(script, key, *arguments)

    a._redis.run_replicated_script = late  # type: ignore[method-assign]
    with pytest.raises(RedisUnavailable, match="was gone before a replica had it"):
        await a.add(one, Delivery(), LIMIT)
    assert await a.get_record(one.id) is None
    assert await held(a) == []  # and deletes what it lists
    await a.announce_end()
    assert {*server.lasting_keys()} <= {KEYS.queue(one.id)}


async def test_a_replica_that_is_gone_is_not_waited_for(
    server: ReplicatedMemory | Replicated, a: SubscriptionStore
) -> None:
    server.lose()
    try:
        one = a_subscription()
        a._redis.run_replicated_script = None  # type: ignore[assignment,method-assign]
        await a.add(one, Delivery(), LIMIT)
        assert await held(a) == [one]
    finally:
        server.resume()


@pytest.mark.parametrize("server", REAL[1:], indirect=True)
async def test_the_lists_in_which_a_callback_is_found_are_with_replicas_too(
    server: Replicated, a: SubscriptionStore
) -> None:
    """The replica of one list's master is stopped or gone; that of the record works."""

    def of(key: str) -> int:
        return next(number for number, replica in enumerate(server.replicas) if replica.has(key))

    known = a_subscription()
    await a.add(known, Delivery(), LIMIT)
    for key in (KEYS.held("a"), KEYS.owner(OWNER), KEYS.client(known.client)):
        replica, node = server.replicas[of(key)], server.nodes[of(key)]
        others = [one for one in (a_subscription() for _ in range(200)) if not served_by(node, KEYS.record(one.id))]
        replica.pause()
        try:
            with pytest.raises(RedisUnavailable, match="no replica of Redis confirmed"):
                await a.add(others[0], Delivery(), LIMIT)
            assert await a.get_record(others[0].id) is None
        finally:
            replica.resume()
        replica.kill()
        try:
            eventually(lambda node=node: "state=online" not in node.ask("INFO replication"), "it is missed")
            await a.add(others[1], Delivery(), LIMIT)
        finally:
            server.resume()


def served_by(node: Server, key: str) -> bool:
    """Return True if the key's slot is the node's, whether the key exists or not."""
    return not node.ask("EXISTS", key).startswith("-MOVED")


# Last: afterwards a replica is the master.
@pytest.mark.parametrize("server", REAL[1:], indirect=True)
async def test_a_confirmation_is_not_asked_of_a_server_that_is_master_no_longer(
    server: Replicated, a: SubscriptionStore
) -> None:
    one, ask = a_subscription(), a._redis.run_replicated_script

    def fail_over(key: str) -> None:
        pairs = zip(server.nodes, server.replicas, strict=True)
        node, replica = next(pair for pair in pairs if pair[0].has(key))
        assert replica.ask("CLUSTER FAILOVER TAKEOVER") == "+OK"
        eventually(lambda: "role:slave" in node.ask("INFO replication"), "the master is a replica")

    async def late(script: str, key: str, *arguments: str) -> Any:
        fail_over(key)
        return await ask(script, key, *arguments)

    a._redis.run_replicated_script = late  # type: ignore[method-assign]
    with pytest.raises(RedisUnavailable, match="MovedError"):
        await a.add(one, Delivery(), LIMIT)
    assert await a.get_record(one.id) is None
    assert await a.held_records() == await a.records_of_owner(OWNER) == []
