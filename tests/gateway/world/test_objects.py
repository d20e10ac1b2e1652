"""Objects of the world as several gateways change them at once, at a real server."""

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from redis_servers import Servers, single
from running import PATIENCE_S

from gateway.fleet.model import Pose
from gateway.live import Live
from gateway.settings import GatewaySettings
from gateway.world.memory import Objects
from gateway.world.scene import SceneObject, Sphere
from gateway.world.store import ObjectStore

NOWHERE = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


@dataclass
class Known:
    """One gateway's copy, and the store that it reads from."""

    objects: Objects
    store: ObjectStore


Open = Callable[[], AbstractAsyncContextManager[Known]]


@pytest.fixture(scope="module")
def servers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Servers]:
    with single(tmp_path_factory.mktemp("redis")) as running:
        yield running


@pytest.fixture
def known(servers: Servers, tmp_path: Path) -> Open:
    @asynccontextmanager
    async def make() -> Any:
        store = ObjectStore(servers.url, tmp_path.name)
        async with Objects(Live(GatewaySettings()), store) as objects:
            yield Known(objects, store)

    return make


def ball(title: str) -> SceneObject:
    return SceneObject(title=title, kind="obstacle", pose=NOWHERE, geometry=Sphere(1.0))


def deafened(one: Known) -> None:
    """From now on it does not hear what others do."""
    assert one.objects._following is not None
    one.objects._following.cancel()


async def until(probe: Callable[[], Awaitable[bool]]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while True:
            if await probe():
                return
            await asyncio.sleep(0.01)


def test_who_would_replace_what_another_gateway_has_replaced_learns_of_it_instead(known: Open) -> None:
    async def run() -> None:
        async with known() as one, known() as other:
            deafened(other)
            id = await one.objects.add(ball("first"))
            assert not await other.objects.change(id, ball("late"))
            assert other.objects.known == one.objects.known == {id: ball("first")}
            assert await one.objects.change(id, ball("second"))
            for late in (ball("late"), None):
                assert not await other.objects.change(id, late)
                assert other.objects.known == {id: ball("second")}
                other.objects._take(id, b"{}")  # of another version: it is not there for this one
            assert await other.store.read(id) is not None
            assert not await other.objects.change(id, ball("late")) and await other.objects.change(id, None)
            assert not await one.objects.change(id, ball("late"))
            assert one.objects.known == other.objects.known == {}

    asyncio.run(run())


def test_an_answer_that_comes_late_is_not_taken_for_news(known: Open) -> None:
    """It was read before the object was replaced, and arrives afterwards."""

    async def run() -> None:
        async with known() as one:
            deafened(one)
            id = await one.objects.add(ball("old"))
            read, under_way, go = one.store.read, asyncio.Event(), asyncio.Event()

            async def slowly(id: str) -> bytes | None:
                one.store.read = read  # type: ignore[method-assign]
                body = await read(id)
                under_way.set()
                await go.wait()
                return body

            one.store.read = slowly  # type: ignore[method-assign]
            late = asyncio.create_task(one.objects._refresh(id))
            await under_way.wait()
            changing = asyncio.create_task(one.objects.change(id, ball("new")))

            async def written() -> bool:
                return b'"new"' in (await read(id) or b"")

            await until(written)
            go.set()
            await late
            assert await changing
            assert one.objects.known == {id: ball("new")}

    asyncio.run(run())


def test_what_was_there_before_the_server_came_is_known_as_soon_as_it_is_there(servers: Servers, known: Open) -> None:
    async def run() -> None:
        async with known() as one:
            id = await one.objects.add(ball("kept"))
        await asyncio.to_thread(servers.kill)
        async with known() as one:
            assert one.objects.known == {}
            await asyncio.to_thread(servers.start)

            async def there() -> bool:
                return one.objects.known == {id: ball("kept")}

            await until(there)

    asyncio.run(run())
