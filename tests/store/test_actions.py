"""Invocations written, read and forgotten; ``test_invocation_model.py`` tests which of them exist."""

import logging
from collections.abc import Iterator
from dataclasses import replace

import pytest

from linked_fleet_gateway.actions.redis_scripts import Keys
from linked_fleet_gateway.actions.store import RETENTION_S, ActionStore
from linked_fleet_state.invocations import InvocationState
from redis_backends import Backend, opened
from store_samples import an_invocation, ended, until

KEYS = Keys()


@pytest.fixture
def kept_s() -> float:
    return RETENTION_S


@pytest.fixture
def a(server: Backend, kept_s: float) -> Iterator[ActionStore]:
    yield from opened(server, ActionStore(server.url, "fleet", "a", kept_s))


@pytest.fixture
def b(server: Backend) -> Iterator[ActionStore]:
    yield from opened(server, ActionStore(server.url, "fleet", "b"))


async def test_an_invocation_is_read_as_it_was_written_by_whichever_gateway(a: ActionStore, b: ActionStore) -> None:
    whole = an_invocation(
        client="später\0", body='<a> <b> "c" .\n', duration_s=0.25, preempts=("x",), facts={"residual_m": 1e-9}
    )
    assert await b.load_invocations() == []
    assert await a.create(whole) is None
    assert await b.read_invocation("r", whole.id) == whole
    assert await b.read_invocation("r", "none") is await b.read_invocation("x", whole.id) is None
    running = replace(whole, state=InvocationState.RUNNING, progress=0.5)
    assert await b.save(running)
    assert await a.read_invocation("r", whole.id) == running
    assert await a.load_invocations() == [running]


async def test_what_was_not_opened_is_opened_when_it_is_saved_whoever_has_the_lease(
    a: ActionStore, b: ActionStore
) -> None:
    """Only that: an invocation that was deleted meanwhile stays away. It may be repeated, with a later state."""
    await b.take_lease("r", "Ada", 60)
    stop, deleted, of_other = an_invocation(), an_invocation(), an_invocation(robot="x")
    assert await a.save_all([stop, deleted, of_other], {stop.id, of_other.id}) == [True, False, True]
    over = ended(stop)
    assert await a.save_all([over], {stop.id}) == [True]
    assert await b.read_invocation("r", stop.id) == over and await b.read_invocation("r", deleted.id) is None
    assert {one.id for one in await b.load_invocations()} == {stop.id, of_other.id}


@pytest.mark.parametrize("kept_s", [1.5])  # longer than two requests take on a busy machine
async def test_ended_invocations_expire_and_open_ones_last_until_their_deadline(
    server: Backend, a: ActionStore
) -> None:
    over, still, later = ended(an_invocation()), an_invocation(), an_invocation(robot="x", deadline_ns=0)
    await a.create(over, idempotency_key="k", request_digest="d")
    await a.create(still)
    assert {one.id for one in await a.load_invocations()} == {over.id, still.id}

    async def forgotten() -> bool:
        return await a.read_invocation("r", over.id) is None and not await a._redis.execute(
            "EXISTS", KEYS.idempotency_key("r", "k")
        )

    await until(forgotten, "what is over is forgotten, and its key")
    assert await a.load_invocations() == [still]
    assert (
        await a.create(ended(an_invocation()), idempotency_key="k", request_digest="e") is None
    )  # the key is free again
    await a.save(ended(still))
    await a.create(later)

    async def empty() -> bool:
        return not await a.load_invocations() and not await a._redis.execute("ZCARD", KEYS.robots)

    await until(empty, "all is forgotten, the names of the robots too")
    assert server.lasting_keys() == [KEYS.news]


async def test_keys_of_an_abandoned_robot_expire(server: Backend, a: ActionStore) -> None:
    await a.create(ended(an_invocation()), idempotency_key="k", request_digest="d")
    await a.create(an_invocation())
    await a.take_lease("r", "Ada", 60)
    assert {*server.lasting_keys()} <= {KEYS.news, KEYS.robots}


async def test_records_of_other_versions_are_kept(a: ActionStore, caplog: pytest.LogCaptureFixture) -> None:
    one, strange = an_invocation(), an_invocation()
    await a.create(one)
    await a.create(strange)
    await a._redis.execute("HSET", KEYS.invocations("r")[0], strange.id, '{"id":7}')
    with caplog.at_level(logging.WARNING):
        assert await a.load_invocations() == [one]
        assert await a.read_invocation("r", strange.id) is None
    assert len(caplog.records) == caplog.text.count("is left alone") == 2
