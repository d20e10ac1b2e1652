"""Mesh files that a URDF names: located, described and read. Independent of Zenoh."""

import hashlib
import logging
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from linked_fleet_agent.urdf import parse
from linked_fleet_agent.wire.messages import MAX_MESH_BYTES, MAX_MESH_URI, MAX_MESHES, Mesh

_log = logging.getLogger(__name__)

FORMATS: Mapping[str, str] = {".stl": "model/stl", ".dae": "model/vnd.collada+xml", ".obj": "model/obj"}
"""Media types (IANA) by suffix in lower case; meshes of other suffixes are not offered."""
# Folder names that packages use for URDFs, beside the folder of the meshes.
_URDF_FOLDERS = ("urdf", "robots", "model", "models")


class MeshError(Exception):
    """A mesh that is not available; the message gives the reason."""


def mesh_files(urdf: str, file: Path) -> dict[str, Path]:
    """Return the existing mesh files that the URDF at ``file`` names, by their URI in it. Raises UrdfError.

    Visual meshes come first, because they show the robot. Collision meshes follow.
    """
    located = {
        uri: locate_mesh(uri, file) for uri in dict.fromkeys(_named(urdf)) if Path(uri).suffix.lower() in FORMATS
    }
    return {uri: path for uri, path in located.items() if path is not None}


def _named(urdf: str) -> Iterator[str]:
    links = parse(urdf).findall("link")
    for kind in ("visual", "collision"):
        for link in links:
            for mesh in link.findall(f"{kind}/geometry/mesh"):
                yield mesh.get("filename", "")


def locate_mesh(uri: str, file: Path) -> Path | None:
    """Return the file that a mesh URI (package, file or path) of the URDF at ``file`` means; None if absent or not
    allowed.

    The file must lie in the package of the URI or in the URDF's own tree, also after resolving symbolic links. A URDF
    from elsewhere must not be able to name other files of this machine.
    """
    file = file.resolve()
    own = _tree_of(file)
    for root, path in _candidates(uri, file, own):
        try:
            if path.is_file() and path.resolve().is_relative_to(root.resolve()):
                return path.resolve()
        except (OSError, ValueError):  # too long, or not readable by this user
            continue
    return None


def _candidates(uri: str, file: Path, own: Path) -> Iterator[tuple[Path, Path]]:
    """Yield pairs of a root folder and a candidate path that must lie in it."""
    if not uri.startswith("package://"):
        path = uri.removeprefix("file://")
        for folder in file.parents:
            if folder.is_relative_to(own):
                yield own, folder / path
        return
    package, _, inside = uri.removeprefix("package://").partition("/")
    if package in ("", ".", ".."):
        return
    for folder in file.parents[:-1]:  # folders in the root of the file system are no packages
        yield folder / package, folder / package / inside
    yield own, own / inside  # the folder of a package may have another name than the package


def _tree_of(file: Path) -> Path:
    """Return the folder that belongs to the URDF: its package, or the folder around it."""
    for folder in file.parents[:-1]:
        if (folder / "package.xml").is_file():
            return folder
    beside = file.parent.name in _URDF_FOLDERS and len(file.parents) > 2
    return file.parent.parent if beside else file.parent


class _File(NamedTuple):
    path: Path
    size: int


class MeshFiles:
    """Meshes on disk by their SHA-256 digest. ``read`` may be called from any thread; contents are not cached."""

    def __init__(self, robot: str, paths: Mapping[str, Path]) -> None:
        self._files: dict[str, _File] = {}
        found = (self._offer(robot, uri, path) for uri, path in paths.items())
        self.offers: tuple[Mesh, ...] = tuple(mesh for mesh in found if mesh is not None)[:MAX_MESHES]

    def _offer(self, robot: str, uri: str, path: Path) -> Mesh | None:
        kind = FORMATS.get(path.suffix.lower())
        try:
            with path.open("rb") as file:
                size, digest = path.stat().st_size, hashlib.file_digest(file, "sha256").hexdigest()
        except OSError as error:
            _log.warning("%s: mesh %s cannot be read: %s", robot, uri, error.strerror)
            return None
        if kind is None or not 0 < size <= MAX_MESH_BYTES or not 0 < len(uri) <= MAX_MESH_URI:
            _log.warning("%s: mesh %.200s of %d bytes is not offered: too large, empty or unknown", robot, uri, size)
            return None
        self._files[digest] = _File(path, size)
        return Mesh(uri=uri, sha256=digest, size=size, type=kind)

    def read(self, question: bytes) -> bytes:
        """Return the mesh whose hexadecimal digest is ``question``. Raises MeshError."""
        digest = question.decode("ascii", "replace")
        file = self._files.get(digest)
        if file is None:
            raise MeshError(f"{digest[:64]!r} is not the digest of a mesh of this robot")
        try:
            with file.path.open("rb") as opened:
                content = opened.read(file.size + 1)
        except OSError as error:
            raise MeshError(f"the mesh cannot be read: {error.strerror}") from error
        if hashlib.sha256(content).hexdigest() != digest:
            raise MeshError("the mesh was changed since the agent described it")
        return content
