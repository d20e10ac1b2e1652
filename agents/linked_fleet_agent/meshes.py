"""The meshes that a URDF names: where they lie, what is said of them, their bytes when somebody asks. Pure of Zenoh."""

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
# Where packages keep their URDFs, beside the folder with the meshes.
_URDF_FOLDERS = ("urdf", "robots", "model", "models")


class MeshError(Exception):
    """A mesh that cannot be had; the message says why."""


def named(urdf: str, file: Path) -> dict[str, Path]:
    """The meshes that are there of those that the URDF at ``file`` names, by their URI in it. UrdfError.

    Those of visual geometry come first: they show the robot. Those of collision geometry say what it would meet.
    """
    located = {uri: locate(uri, file) for uri in dict.fromkeys(_named(urdf)) if Path(uri).suffix.lower() in FORMATS}
    return {uri: path for uri, path in located.items() if path is not None}


def _named(urdf: str) -> Iterator[str]:
    links = parse(urdf).findall("link")
    for kind in ("visual", "collision"):
        for link in links:
            for mesh in link.findall(f"{kind}/geometry/mesh"):
                yield mesh.get("filename", "")


def locate(uri: str, file: Path) -> Path | None:
    """The file that a mesh URI of the URDF at ``file`` means (package, file or a path), if it is there and allowed.

    Allowed is what lies in the package of the URI or in the URDF's own tree, also after following symbolic links: a
    URDF from somewhere else must not name files of this machine.
    """
    file = file.resolve()
    own = _tree_of(file)
    for root, path in _candidates(uri, file, own):
        try:
            if path.is_file() and path.resolve().is_relative_to(root.resolve()):
                return path.resolve()
        except (OSError, ValueError):  # too long, or not ours to look at: no file that this robot may use
            continue
    return None


def _candidates(uri: str, file: Path, own: Path) -> Iterator[tuple[Path, Path]]:
    """Pairs of a folder that must not be left and a path that may lie in it."""
    if not uri.startswith("package://"):
        path = uri.removeprefix("file://")
        for folder in file.parents:
            if folder.is_relative_to(own):
                yield own, folder / path
        return
    package, _, inside = uri.removeprefix("package://").partition("/")
    if package in ("", ".", ".."):
        return
    for folder in file.parents[:-1]:  # nothing that lies in the root of the file system is a package
        yield folder / package, folder / package / inside
    yield own, own / inside  # its folder may be called otherwise than the package


def _tree_of(file: Path) -> Path:
    """The folder that belongs to the URDF: its package, or where it lies."""
    for folder in file.parents[:-1]:
        if (folder / "package.xml").is_file():
            return folder
    beside = file.parent.name in _URDF_FOLDERS and len(file.parents) > 2
    return file.parent.parent if beside else file.parent


class _File(NamedTuple):
    path: Path
    size: int


class MeshFiles:
    """Meshes on disk, known by their digest. ``read`` may be called from any thread; no bytes are kept."""

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
        """The bytes whose digest, in hexadecimal, is the question. MeshError for everything else."""
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
