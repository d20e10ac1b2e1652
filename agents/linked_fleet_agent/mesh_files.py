"""Mesh files that a URDF names: located, described and read. Independent of Zenoh."""

import hashlib
import logging
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote

from linked_fleet_agent.urdf import parse
from linked_fleet_agent.wire.messages import MAX_MESH_BYTES, MAX_MESH_URI, MAX_MESHES, Mesh

_log = logging.getLogger(__name__)

FORMATS: Mapping[str, str] = {
    ".stl": "model/stl",
    ".dae": "model/vnd.collada+xml",
    ".obj": "model/obj",
    ".glb": "model/gltf-binary",
}
"""Media types (IANA) by suffix in lower case; meshes of other suffixes are not offered."""
# Folder names that packages use for URDFs, beside the folder of the meshes.
_URDF_FOLDERS = ("urdf", "robots", "model", "models")
_MOST_LOGGED, _LONGEST_LOGGED = 3, 200
_MOST_ENTRIES = 10_000  # of a folder in which a name in another case is searched
_LONGEST_MANIFEST = 65_536


class MeshError(Exception):
    """A mesh that is not available; the message gives the reason."""


@dataclass(frozen=True)
class MeshRoots:
    """Folders from which meshes may be offered, beside the package of the URDF.

    A folder has packages, or is one. ``prefixes`` are install prefixes of ROS 2, whose packages are in ``share``.
    """

    folders: tuple[Path, ...] = ()
    prefixes: tuple[Path, ...] = ()

    @classmethod
    def from_environment(cls, folders: Sequence[str], environment: Mapping[str, str]) -> "MeshRoots":
        """Return ``folders``, then those of ``ROS_PACKAGE_PATH``, and the prefixes of ``AMENT_PREFIX_PATH``."""
        packages = [*folders, *environment.get("ROS_PACKAGE_PATH", "").split(os.pathsep)]
        prefixes = environment.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
        return cls(tuple(Path(each) for each in packages if each), tuple(Path(each) for each in prefixes if each))

    def package(self, name: str) -> Iterator[Path]:
        """Yield the folders that may be the package ``name``."""
        for folder in self.folders:
            yield folder / name
            if folder.name == name or _package_name(folder) == name:
                yield folder
        for prefix in self.prefixes:
            yield prefix / "share" / name


NO_ROOTS = MeshRoots()


def mesh_files(urdf: str, file: Path | None, roots: MeshRoots = NO_ROOTS, robot: str = "") -> dict[str, Path]:
    """Return the existing mesh files that a URDF names, by their URI in it. Raises UrdfError.

    ``file`` is the file of the URDF, if it has one. Visual meshes come first, because they show the robot. Collision
    meshes follow. Those that are not offered are logged once for the ``robot``, with the reason.
    """
    found: dict[str, Path] = {}
    missing: dict[str, str] = {}
    for uri in dict.fromkeys(_named(urdf)):
        try:
            found[uri] = _located(uri, file, roots)
        except MeshError as error:
            missing[uri] = str(error)
    if missing:
        named = [f"{uri[:_LONGEST_LOGGED]!r}: {why}" for uri, why in islice(missing.items(), _MOST_LOGGED)]
        more = [f"and {len(missing) - _MOST_LOGGED} more"] if len(missing) > _MOST_LOGGED else []
        count = len(found) + len(missing)
        _log.warning("%s: %d of %d meshes are not offered: %s", robot, len(missing), count, "; ".join(named + more))
    return found


def _named(urdf: str) -> Iterator[str]:
    links = parse(urdf).findall("link")
    for kind in ("visual", "collision"):
        for link in links:
            for mesh in link.findall(f"{kind}/geometry/mesh"):
                yield mesh.get("filename", "")


def _located(uri: str, file: Path | None, roots: MeshRoots) -> Path:
    """Return the file of a mesh URI. Raises MeshError with the reason if it cannot be offered."""
    suffix = Path(uri.rstrip("/")).suffix.lower()
    if suffix not in FORMATS:
        raise MeshError(f"{suffix or 'a name without suffix'} is none of the formats {', '.join(FORMATS)}")
    path = locate_mesh(uri, file, roots)
    if path is None:
        raise MeshError("there is no such file in the folders that meshes may come from")
    return path


def locate_mesh(uri: str, file: Path | None, roots: MeshRoots = NO_ROOTS) -> Path | None:
    """Return the file that a mesh URI (package, model, file or path) of the URDF at ``file`` means.

    Percent escapes, backslashes, and a different case of letters are understood, as are parents that the URDF does not
    have. None if it is absent or not allowed: the file must lie in the package of the URI, in the URDF's own tree or
    in one of the ``roots``, also after resolving symbolic links. A URDF from elsewhere must not be able to name other
    files of this machine.
    """
    file = None if file is None else file.resolve()
    spellings = dict.fromkeys((uri, unquote(uri), unquote(uri).replace("\\", "/")))
    for find in (_exact, _in_any_case):
        for spelling in spellings:
            for root, path in _candidates(spelling, file, roots):
                try:
                    found = find(root, path)
                    if found is not None and found.is_file() and root.resolve() in found.resolve().parents:
                        return found.resolve()
                except (OSError, ValueError):  # too long, or not readable by this user
                    continue
    return None


def _exact(root: Path, path: Path) -> Path | None:
    return path


def _in_any_case(root: Path, path: Path) -> Path | None:
    """Return the only file whose path below ``root`` differs in the case of letters only; None if there is no such."""
    try:
        parts = Path(os.path.normpath(path)).relative_to(os.path.normpath(root)).parts
    except ValueError:
        return None
    found = root
    for part in parts:
        exact = found / part
        if not exact.exists():
            entries = islice(found.iterdir(), _MOST_ENTRIES)
            same = [each for each in entries if each.name.casefold() == part.casefold()]
            if len(same) != 1:
                return None
            (exact,) = same
        found = exact
    return found


def _candidates(uri: str, file: Path | None, roots: MeshRoots) -> Iterator[tuple[Path, Path]]:
    """Yield pairs of a root folder and a candidate path that must lie in it."""
    scheme, separator, rest = uri.partition("://")
    if uri.startswith("file:"):
        yield from _by_path(re.sub(r"^file:(//(localhost(?=/))?)?", "", uri), file, roots)
    elif not separator:
        yield from _by_path(uri, file, roots)
    elif scheme in ("package", "model"):
        yield from _in_package(*rest.lstrip("/").partition("/")[::2], file, roots)
        yield from _by_path(rest, file, roots)


def _in_package(package: str, inside: str, file: Path | None, roots: MeshRoots) -> Iterator[tuple[Path, Path]]:
    if package in ("", ".", "..") or not inside:
        return
    if file is not None:
        for folder in file.parents[:-1]:  # folders in the root of the file system are no packages
            yield folder / package, folder / package / inside
    for folder in roots.package(package):
        yield folder, folder / inside
    if file is not None:
        own = _tree_of(file)
        yield own, own / inside  # the folder of a package may have another name than the package
    for folder in roots.folders:
        yield folder, folder / inside


def _by_path(path: str, file: Path | None, roots: MeshRoots) -> Iterator[tuple[Path, Path]]:
    """Yield the candidates of an absolute or relative path: relative to the URDF, then to the roots."""
    share, _, installed = path.rpartition("/share/")  # of another machine, where the package is installed
    if share and file is None:
        package, _, inside = installed.partition("/")
        yield from _in_package(package, inside, file, roots)
    allowed = roots.folders + tuple(prefix / "share" for prefix in roots.prefixes)
    below = re.sub(r"^(?:\.{0,2}/)+", "", path)
    if file is not None:
        own = _tree_of(file)
        for folder in file.parents:
            if folder.is_relative_to(own):
                yield own, folder / path
        for root in allowed:
            yield root, file.parent / path
        yield own, own / below
    for root in allowed:
        yield root, root / path
        yield root, root / below


def _tree_of(file: Path) -> Path:
    """Return the folder that belongs to the URDF: its package, or the folder around it."""
    for folder in file.parents[:-1]:
        if (folder / "package.xml").is_file():
            return folder
    beside = file.parent.name in _URDF_FOLDERS and len(file.parents) > 2
    return file.parent.parent if beside else file.parent


@lru_cache(maxsize=256)
def _package_name(folder: Path) -> str:
    """Return the name in a package's manifest; empty without one."""
    try:
        text = (folder / "package.xml").read_text(encoding="utf-8", errors="replace")[:_LONGEST_MANIFEST]
    except OSError:
        return ""
    name = re.search(r"<name>\s*([^<\s]+)\s*</name>", text)
    return name[1] if name else ""


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
