"""Records of a table, such as the objects of the world, changed by several gateways at once."""

from collections.abc import Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass
from typing import Any

import pytest

from linked_fleet_base.errors import ContainerFull
from linked_fleet_base.faults import Faults
from linked_fleet_gateway.extensions.world.scene import SceneObject, Sphere, decode, encode
from linked_fleet_gateway.extensions.world.service import stored_objects
from linked_fleet_runtime.table import Changed, Full, StoredRecords, Table, digest
from linked_fleet_state.model import Pose
from redis_backends import Backend
from store_samples import until

NOWHERE = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


@dataclass
class Known:
    """One gateway's copy, and the store that it reads from."""

    objects: Table[SceneObject]
    store: StoredRecords
    faults: Faults


Open = Callable[[], AbstractAsyncContextManager[Known]]


@pytest.fixture
def known(server: Backend) -> Open:
    @asynccontextmanager
    async def make() -> Any:
        store, faults = stored_objects(server.url, "fleet"), Faults()
        async with Table(store, "objects", encode, decode, faults=faults) as objects:
            yield Known(objects, store, faults)

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
            other.objects._take(id, b"{}")  # from another version: ignored by this one, which says so
            (told,) = other.faults.of_parts
            assert id in told
        assert await other.store.read(id) is not None
        assert other.objects.unreadable == [id] and one.objects.unreadable == []
        assert not await other.objects.change(id, ball("late")) and await other.objects.change(id, None)
        assert not await one.objects.change(id, ball("late"))
        assert one.objects.known == other.objects.known == {}
        assert not other.faults.of_parts


async def test_there_is_room_for_so_many_objects_and_bytes(known: Open) -> None:
    async with known() as one:
        store = one.store
        store.limits = 2, 10
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
        with pytest.raises(ContainerFull, match="at most 2 objects"):
            await one.objects.add(ball("too long"))


async def test_tables_of_one_room_do_not_mix(server: Backend) -> None:
    heard = list[str]()
    stored = [StoredRecords(server.url, "fleet", "room", name) for name in ("a", "b")]

    def tables(name: str, stored: StoredRecords) -> Table[bytes]:
        return Table(stored, name, bytes, bytes, lambda id, before, after: heard.append(f"{name} {after!r}"))

    other = StoredRecords(server.url, "fleet", "room", "a")
    async with tables("a", stored[0]) as first, tables("b", stored[1]) as second:
        await other.change("x", "", b"1")

        async def seen() -> bool:
            return dict(first.known) == {"x": b"1"}

        await until(seen, "the record of the first table")
        assert heard == ["a b'1'"] and not second.known
    await other.close()


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
