"""A cache folder of parsed meshes, each in a file named by the digest of its source.

Several gateways may share the folder: files appear atomically, and a missing one is parsed again. A damaged file, and
one that another user could have written, is ignored. Files contain data only, no code.
"""

import hashlib
import logging
import os
import re
import stat
import struct
import tempfile
from contextlib import suppress
from pathlib import Path

import numpy as np

from linked_fleet_gateway.extensions.world.surfaces import Surface

MOST_BYTES = 256 * 2**20
_MAGIC = b"linked fleet mesh 1\n"  # increment the number with every change of how meshes are parsed
_HEAD = struct.Struct("<?II")
_DIGEST_BYTES = 32
_NAME = re.compile(r"[0-9a-f]{64}\.(stl|dae|obj)")
_log = logging.getLogger(__name__)


class MeshCache:
    """The cache. Without a usable folder nothing is stored."""

    def __init__(self, folder: Path | None, most_bytes: int = MOST_BYTES) -> None:
        self._folder, self._most_bytes = folder, most_bytes
        if folder is not None and not _own_folder(folder):
            _log.warning("meshes are not kept in %s: it cannot be written, or others can write it", folder)
            self._folder = None

    def get(self, name: str) -> Surface | None:
        """Return the mesh stored under a name, which is the digest of its source file."""
        if self._folder is None or not _NAME.fullmatch(name):
            return None
        try:
            content = _read(self._folder / name, self._most_bytes)
        except OSError:
            return None
        return None if content is None else _decoded(content)

    def put(self, name: str, surface: Surface) -> None:
        if self._folder is None or not _NAME.fullmatch(name):
            return
        content = _encoded(surface)
        if len(content) > self._most_bytes:
            return
        try:
            self._make_room(len(content))
            with tempfile.NamedTemporaryFile(dir=self._folder, prefix=".new-", delete=False) as file:
                try:
                    file.write(content)
                    file.flush()
                    Path(file.name).replace(self._folder / name)
                except BaseException:
                    Path(file.name).unlink(missing_ok=True)
                    raise
        except OSError as error:
            _log.warning("a mesh is not kept in %s: %s", self._folder, error.strerror)

    def _make_room(self, size: int) -> None:
        """Remove the least recently used files, including leftovers of crashes."""
        assert self._folder is not None
        found = []
        for entry in os.scandir(self._folder):
            with suppress(FileNotFoundError):  # another gateway was faster
                about = entry.stat(follow_symlinks=False)
                found.append((about.st_mtime_ns, about.st_size, entry.path))
        total = sum(size for _, size, _ in found)
        for _, each, path in sorted(found):
            if total + size <= self._most_bytes:
                break
            with suppress(FileNotFoundError):
                Path(path).unlink()
            total -= each


def _own_folder(folder: Path) -> bool:
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        about = folder.lstat()
    except OSError:
        return False
    return stat.S_ISDIR(about.st_mode) and _is_ours(about) and os.access(folder, os.W_OK)


def _is_ours(about: os.stat_result) -> bool:
    return about.st_uid == os.geteuid() and not about.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _read(path: Path, most_bytes: int) -> bytes | None:
    """Read a file of ours, else return None. Its modification time is set to that of its last use."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC | os.O_NONBLOCK)
    with os.fdopen(descriptor, "rb") as file:
        about = os.fstat(descriptor)
        if not stat.S_ISREG(about.st_mode) or not _is_ours(about) or about.st_size > most_bytes:
            return None
        os.utime(descriptor)
        return file.read(most_bytes)


def _encoded(surface: Surface) -> bytes:
    body = b"".join(
        (
            _HEAD.pack(surface.fills_hull, len(surface.vertices), len(surface.triangles)),
            surface.vertices.astype("<f8").tobytes(),
            surface.triangles.astype("<i4").tobytes(),
        )
    )
    return _MAGIC + hashlib.sha256(body).digest() + body


def _decoded(content: bytes) -> Surface | None:
    magic, start = content[: len(_MAGIC)], len(_MAGIC) + _DIGEST_BYTES
    body = memoryview(content)[start:]
    if magic != _MAGIC or len(body) < _HEAD.size or hashlib.sha256(body).digest() != content[len(_MAGIC) : start]:
        return None
    fills_hull, vertices, triangles = _HEAD.unpack_from(body)
    middle = _HEAD.size + 24 * vertices
    if len(body) != middle + 12 * triangles or not triangles:
        return None
    points = np.frombuffer(body[_HEAD.size : middle], "<f8").reshape(-1, 3)
    corners = np.frombuffer(body[middle:], "<i4").reshape(-1, 3)
    if not np.isfinite(points).all() or corners.min() < 0 or corners.max() >= vertices:
        return None
    return Surface(points, corners, fills_hull)
