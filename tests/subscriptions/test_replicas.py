"""Callbacks on servers with replicas: accepted is what a replica has as well, and nothing else."""

import asyncio
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from redis_servers import Server, Servers, cluster, cluster_replicated, single, single_replicated
from running import eventually

from gateway.subscriptions.keys import Keys
from gateway.subscriptions.store import Store, StoreUnavailable
from gateway.subscriptions.subscription import Delivery, Kind, Subscription

LIMIT = 100


@pytest.fixture(scope="module", params=[single_replicated, cluster_replicated])
def servers(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Servers]:
    with request.param(tmp_path_factory.mktemp("redis")) as running:
        yield running


@pytest.fixture
def keys() -> Keys:
    return Keys(uuid.uuid4().hex)


@pytest.fixture
def store(servers: Servers, keys: Keys) -> Callable[[str], Store]:
    return lambda run: Store(servers.url, keys.namespace, run)


def a_subscription(kind: Kind = Kind.CALLBACK) -> Subscription:
    return Subscription(
        str(uuid.uuid4()), "/arm", "/arm/joint", kind, "text/turtle", "http://localhost:8000", "192.0.2.7", created_ns=1
    )


def replicated(servers: Servers, key: str) -> bool:
    return any(replica.has(key) for replica in servers.replicas)


def test_what_is_accepted_is_with_a_replica(servers: Servers, keys: Keys, store: Callable[[str], Store]) -> None:
    async def run() -> None:
        async with store("a") as a:
            for _ in range(30):
                one = a_subscription()
                await a.add(one, Delivery(), LIMIT)
                assert replicated(servers, keys.record(one.id))
                assert replicated(servers, keys.queue(one.id))

    asyncio.run(run())


def test_what_no_replica_confirms_is_not_accepted_and_nothing_is_left(
    servers: Servers, keys: Keys, store: Callable[[str], Store]
) -> None:
    """The replicas hang: their masters still count them."""

    async def run() -> None:
        async with store("a") as a, store("b") as b:
            before = [a_subscription() for _ in range(9)]  # connections whose earlier writes are confirmed
            await asyncio.gather(*(a.add(one, Delivery(), LIMIT) for one in before))
            for replica in servers.replicas:
                replica.pause()
            try:
                refused = [a_subscription() for _ in range(9)]
                results = await asyncio.gather(
                    *(a.add(one, Delivery(), LIMIT) for one in refused), return_exceptions=True
                )
                assert {type(result) for result in results} == {StoreUnavailable}, results
                for one, result in zip(refused, results, strict=True):
                    assert str(result) == f"no replica of Redis confirmed subscription {one.id} in time"
                stream = a_subscription(Kind.WEBSOCKET)
                await a.renew()
                await a.add(stream, Delivery(), LIMIT)
                listed = {record.subscription.id for record in await b.of("/arm")}
                assert listed == {stream.id, *(one.id for one in before)}
                assert {record.subscription.id for record in await a.held()} == listed
                for id in listed:
                    await a.remove(id)
                await a.leave()
                assert servers.lasting_keys(f"{keys.namespace}:*") == []
            finally:
                for replica in servers.replicas:
                    replica.resume()
            one = a_subscription()
            await until_added(a, one)
            assert replicated(servers, keys.record(one.id))
            assert not any(replicated(servers, keys.record(each.id)) for each in refused)

    asyncio.run(run())


async def until_added(store: Store, subscription: Subscription) -> None:
    """The replicas may be about to read what came while they hung."""
    for _ in range(20):
        try:
            return await store.add(subscription, Delivery(), LIMIT)
        except StoreUnavailable:
            continue
    pytest.fail("no replica confirms")


def test_a_subscription_that_vanishes_before_it_is_confirmed_is_not_accepted(
    servers: Servers, keys: Keys, store: Callable[[str], Store]
) -> None:
    """As in a failover to a replica that did not have it yet."""

    async def run() -> None:
        async with store("a") as a:
            one = a_subscription()
            ask = a._redis.replicated

            async def late(script: str, key: str, *arguments: str) -> Any:
                await a._redis.one("DEL", key)
                return await ask(script, key, *arguments)

            a._redis.replicated = late  # type: ignore[method-assign]
            with pytest.raises(StoreUnavailable, match="was gone before a replica had it"):
                await a.add(one, Delivery(), LIMIT)
            assert await a.record(one.id) is None
            assert await a.held() == []  # and clears away what it lists
            await a.leave()
            left = [key for key in servers.lasting_keys(f"{keys.namespace}:*") if key != keys.queue(one.id)]
            assert left == []

    asyncio.run(run())


def test_a_confirmation_is_not_asked_of_a_server_that_is_master_no_longer(tmp_path: Path, keys: Keys) -> None:
    async def run(servers: Servers) -> None:
        async with Store(servers.url, keys.namespace, "a") as a:
            one = a_subscription()
            ask = a._redis.replicated

            def fail_over(key: str) -> None:
                node, replica = next(
                    pair for pair in zip(servers.nodes, servers.replicas, strict=True) if pair[0].has(key)
                )
                assert replica.ask("CLUSTER FAILOVER TAKEOVER") == "+OK"
                eventually(lambda: "role:slave" in node.ask("INFO replication"), "the master is a replica")

            async def late(script: str, key: str, *arguments: str) -> Any:
                await asyncio.to_thread(fail_over, key)
                return await ask(script, key, *arguments)

            a._redis.replicated = late  # type: ignore[method-assign]
            with pytest.raises(StoreUnavailable, match="MovedError"):
                await a.add(one, Delivery(), LIMIT)
            assert await a.record(one.id) is None
            assert await a.held() == await a.of("/arm") == []

    with cluster_replicated(tmp_path) as servers:
        asyncio.run(run(servers))


@pytest.mark.parametrize("servers", [cluster_replicated], indirect=True)
def test_the_lists_in_which_a_callback_is_found_are_with_replicas_too(
    servers: Servers, keys: Keys, store: Callable[[str], Store]
) -> None:
    """The replica of one list's master hangs, or is gone; that of the record is well."""

    def of(key: str) -> int:
        return next(number for number, replica in enumerate(servers.replicas) if replica.has(key))

    async def run() -> None:
        async with store("a") as a:
            known = a_subscription()
            await a.add(known, Delivery(), LIMIT)
            for key in (keys.held("a"), keys.owner("/arm"), keys.client(known.client)):
                replica, node = servers.replicas[of(key)], servers.nodes[of(key)]
                others = [
                    one for one in (a_subscription() for _ in range(200)) if not served(node, keys.record(one.id))
                ]
                replica.pause()
                try:
                    with pytest.raises(StoreUnavailable, match="no replica of Redis confirmed"):
                        await a.add(others[0], Delivery(), LIMIT)
                    assert await a.record(others[0].id) is None
                finally:
                    replica.resume()
                replica.kill()
                try:
                    eventually(lambda node=node: "state=online" not in node.ask("INFO replication"), "it is missed")
                    await a.add(others[1], Delivery(), LIMIT)
                finally:
                    replica.start()
                    servers.await_replicas()

    asyncio.run(run())


def served(node: Server, key: str) -> bool:
    """Whether the key's slot is the node's, be there such a key or not."""
    return not node.ask("EXISTS", key).startswith("-MOVED")


def test_a_replica_that_is_gone_is_not_waited_for(servers: Servers, store: Callable[[str], Store]) -> None:
    async def run() -> None:
        async with store("a") as a:
            one = a_subscription()
            for replica in servers.replicas:
                replica.kill()
            try:
                for node in servers.nodes:
                    eventually(lambda node=node: "state=online" not in node.ask("INFO replication"), "it is missed")
                await a.add(one, Delivery(), LIMIT)
                assert [record.subscription for record in await a.held()] == [one]
            finally:
                for replica in servers.replicas:
                    replica.start()
                servers.await_replicas()

    asyncio.run(run())


@pytest.mark.parametrize("servers", [single, cluster], indirect=True)
def test_servers_without_replicas_are_not_asked_twice(store: Callable[[str], Store]) -> None:
    async def run() -> None:
        async with store("a") as a:
            one = a_subscription()
            a._redis.replicated = None  # type: ignore[assignment,method-assign]
            await a.add(one, Delivery(), LIMIT)
            assert [record.subscription for record in await a.held()] == [one]

    asyncio.run(run())
