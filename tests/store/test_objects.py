"""Objects of the world changed by several gateways at once."""

from collections.abc import Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass
from typing import Any

import pytest

from linked_fleet_gateway.app.application import create_live
from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_gateway.extensions.world import service as store_module
from linked_fleet_gateway.extensions.world.scene import SceneObject, Sphere
from linked_fleet_gateway.extensions.world.service import Changed, Full, Objects, ObjectStore, digest
from linked_fleet_gateway.fleet.model import Pose
from redis_backends import Backend
from store_samples import until
from virtual.zenoh_network import ZenohNetwork

NOWHERE = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


@dataclass
class Known:
    """One gateway's copy, and the store that it reads from."""

    objects: Objects
    store: ObjectStore


Open = Callable[[], AbstractAsyncContextManager[Known]]


@pytest.fixture
def known(server: Backend) -> Open:
    @asynccontextmanager
    async def make() -> Any:
        store = ObjectStore(server.url, "fleet")
        async with Objects(create_live(GatewaySettings(), ZenohNetwork().gateway("g")), store) as objects:
            yield Known(objects, store)

    return make


def ball(title: str) -> SceneObject:
    return SceneObject(title=title, kind="obstacle", pose=NOWHERE, geometry=Sphere(1.0))


def deafened(one: Known) -> None:
    """From now on it gets no news from others."""
    for task in one.objects._tasks:
        task.cancel()


async def test_replacing_an_outdated_object_raises_changed(known: Open) -> None:
    async with known() as one, known() as other:
        deafened(other)
        id = await one.objects.add(ball("first"))
        assert not await other.objects.change(id, ball("late"))
        assert other.objects.known == one.objects.known == {id: ball("first")}
        assert await one.objects.change(id, ball("second"))
        for late in (ball("late"), None):
            assert not await other.objects.change(id, late)
            assert other.objects.known == {id: ball("second")}
            other.objects._take(id, b"{}")  # from another version: ignored by this one
        assert await other.store.read(id) is not None
        assert not await other.objects.change(id, ball("late")) and await other.objects.change(id, None)
        assert not await one.objects.change(id, ball("late"))
        assert one.objects.known == other.objects.known == {}


async def test_there_is_room_for_so_many_objects_and_bytes(known: Open, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store_module, "MAX_OBJECTS", 2)
    monkeypatch.setattr(store_module, "MAX_BYTES", 10)
    async with known() as one:
        store = one.store
        await store.change("a", "", b"12345")
        with pytest.raises(Full):
            await store.change("b", "", b"123456")
        await store.change("b", "", b"12345")
        with pytest.raises(Full):
            await store.change("c", "", b"")
        with pytest.raises(Full):
            await store.change("b", digest(b"12345"), b"123456")
        with pytest.raises(Changed):
            await store.change("b", digest(b"other"), b"1")
        await store.change("a", digest(b"12345"), b"54321")
        await store.change("b", digest(b"12345"), None)
        assert await store.load() == {"a": b"54321"}


async def test_stored_objects_are_known_once_the_server_is_reachable(server: Backend, known: Open) -> None:
    async with known() as one:
        id = await one.objects.add(ball("kept"))
    server.kill()
    async with known() as one:
        assert one.objects.known == {}
        server.start()

        async def there() -> bool:
            return one.objects.known == {id: ball("kept")}

        await until(there, "the objects are read")
