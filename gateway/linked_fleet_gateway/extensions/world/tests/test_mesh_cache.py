"""Meshes on disk: stored ones are returned, and damaged or foreign files count as missing."""

import os
from pathlib import Path

import numpy as np
import pytest

from linked_fleet_gateway.extensions.world.surfaces import MeshCache, Surface
from meshes import BOX, channel, read

NAMES = [f"{number:064x}.stl" for number in range(8)]
SURFACE = read(channel())


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "state" / "meshes"


def same(one: Surface | None, other: Surface) -> bool:
    return (
        one is not None
        and np.array_equal(one.vertices, other.vertices)
        and np.array_equal(one.triangles, other.triangles)
        and one.fills_hull == other.fills_hull
    )


def size_of(surface: Surface, tmp_path: Path) -> int:
    MeshCache(tmp_path / "size").put(NAMES[0], surface)
    return (tmp_path / "size" / NAMES[0]).stat().st_size


def test_a_cached_mesh_is_usable_by_another_process(folder: Path) -> None:
    for name, surface in zip(NAMES, (SURFACE, read(BOX)), strict=False):
        MeshCache(folder).put(name, surface)
        found = MeshCache(folder).get(name)
        assert found is not None and same(found, surface)
        assert (
            found.exact_shape().num_tris == len(surface.triangles) and found.hull.num_points == surface.hull.num_points
        )
    assert MeshCache(folder).get(NAMES[2]) is None


def test_only_its_owner_can_read_and_write_it(folder: Path) -> None:
    MeshCache(folder).put(NAMES[0], SURFACE)
    assert [oct(each.stat().st_mode & 0o777) for each in (folder, folder / NAMES[0])] == ["0o700", "0o600"]


def test_a_damaged_file_is_as_if_it_were_not_there(folder: Path) -> None:
    cache, file = MeshCache(folder), folder / NAMES[0]
    cache.put(NAMES[0], SURFACE)
    content = file.read_bytes()
    for place in range(0, len(content), 7):
        file.write_bytes(content[:place] + bytes([content[place] ^ 0x10]) + content[place + 1 :])
        assert cache.get(NAMES[0]) is None, place
        file.write_bytes(content[:place])
        assert cache.get(NAMES[0]) is None, place
    file.write_bytes(content + b"\0")
    assert cache.get(NAMES[0]) is None
    cache.put(NAMES[0], SURFACE)
    assert same(cache.get(NAMES[0]), SURFACE)


@pytest.mark.parametrize(
    "broken",
    [
        Surface(SURFACE.vertices, SURFACE.triangles + len(SURFACE.vertices), False),
        Surface(SURFACE.vertices, SURFACE.triangles - 1, False),
        Surface(SURFACE.vertices * np.nan, SURFACE.triangles, False),
        Surface(SURFACE.vertices, SURFACE.triangles[:0], True),
    ],
)
def test_a_file_that_is_whole_and_says_nonsense_is_as_if_it_were_not_there(folder: Path, broken: Surface) -> None:
    cache = MeshCache(folder)
    cache.put(NAMES[0], broken)
    assert (folder / NAMES[0]).exists() and cache.get(NAMES[0]) is None


def test_a_folder_writable_by_others_is_not_read(folder: Path, tmp_path: Path) -> None:
    cache = MeshCache(folder)
    cache.put(NAMES[0], SURFACE)
    elsewhere = tmp_path / "elsewhere"
    (folder / NAMES[0]).rename(elsewhere)
    (folder / NAMES[0]).symlink_to(elsewhere)
    assert cache.get(NAMES[0]) is None
    elsewhere.chmod(0o622)
    elsewhere.rename(folder / NAMES[0])
    assert cache.get(NAMES[0]) is None
    (folder / NAMES[1]).mkdir()
    os.mkfifo(folder / NAMES[2])
    assert cache.get(NAMES[1]) is None and cache.get(NAMES[2]) is None
    folder.chmod(0o777)
    assert MeshCache(folder).get(NAMES[0]) is None


@pytest.mark.parametrize("name", ["", "..", "../x.stl", f"{NAMES[0]}/", NAMES[0].upper() + "X", f"{'0' * 64}.exe"])
def test_a_name_is_the_digest_of_a_mesh_and_nothing_else(folder: Path, name: str) -> None:
    cache = MeshCache(folder)
    cache.put(name, SURFACE)
    assert cache.get(name) is None and list(folder.iterdir()) == []


def test_the_cache_is_bounded_and_keeps_recently_used_meshes(folder: Path, tmp_path: Path) -> None:
    room = 3 * size_of(SURFACE, tmp_path)
    cache = MeshCache(folder, room)
    (folder / ".new-of-a-crash").write_bytes(b"x" * (room // 3))
    os.utime(folder / ".new-of-a-crash", ns=(1, 1))
    for number, name in enumerate(NAMES[:4]):
        cache.put(name, SURFACE)
        os.utime(folder / name, ns=(number + 2, number + 2))
        assert cache.get(NAMES[0]) is not None
        os.utime(folder / NAMES[0], ns=(100, 100))
        assert sum(each.stat().st_size for each in folder.iterdir()) <= room
    assert [cache.get(name) is not None for name in NAMES[:4]] == [True, False, True, True]
    tiny = MeshCache(tmp_path / "tiny", 10)
    tiny.put(NAMES[0], SURFACE)
    assert tiny.get(NAMES[0]) is None


@pytest.mark.parametrize("folder", [None, Path("/dev/null/meshes")])
def test_without_a_folder_nothing_is_kept_and_nothing_fails(folder: Path | None) -> None:
    cache = MeshCache(folder)
    cache.put(NAMES[0], SURFACE)
    assert cache.get(NAMES[0]) is None
