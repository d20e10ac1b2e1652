"""The scripts and styles of the pages, from `scripts/build`: each is named by its content and never changes."""

import json
import logging
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from hashlib import blake2b
from pathlib import Path

from linked_fleet_base.contributions import present

log = logging.getLogger(__name__)

_FOLDER = Path(__file__).parent / "assets"
_MEDIA_TYPES = {".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml", ".txt": "text/plain"}


_CODINGS = {"br": ".br", "gzip": ".gz"}
"""File suffixes of content codings, the smallest result first (RFC 7932, RFC 1952)."""


@dataclass(frozen=True)
class Asset:
    """A file. ``coded``: its content by content coding."""

    media_type: str
    content: bytes
    coded: Mapping[str, bytes]


@dataclass(frozen=True)
class Assets:
    """Built files by name. ``entries`` maps sources to the names of the files that pages refer to."""

    files: Mapping[str, Asset]
    entries: Mapping[str, str]


@cache
def assets() -> Assets:
    """Return all files, read once. Without built files, as in a fresh source tree, pages are plain."""
    try:
        entries: dict[str, str] = json.loads((_FOLDER / "manifest.json").read_text(encoding="utf-8"))
    except FileNotFoundError:
        log.warning("the scripts and styles of the pages are not built: make assets")
        return Assets({}, {})
    files = {
        path.name: Asset(_MEDIA_TYPES[path.suffix], path.read_bytes(), _coded(path))
        for path in _FOLDER.iterdir()
        if path.suffix in _MEDIA_TYPES
    }
    return Assets(files, entries)


def _coded(path: Path) -> dict[str, bytes]:
    files = {coding: path.with_name(path.name + suffix) for coding, suffix in _CODINGS.items()}
    return {coding: file.read_bytes() for coding, file in files.items() if file.exists()}


def _of_views() -> dict[str, Asset]:
    return present().derived("files of views", dict)


def add_file(path: Path) -> str:
    """Serve a script or style of an extension, and return its address, which names its content.

    Raises OSError if it cannot be read, ValueError for a file of another kind.
    """
    if path.suffix not in (".js", ".css"):
        raise ValueError(f"{path.name} is neither a script (.js) nor a style (.css)")
    content = path.read_bytes()
    name = f"{path.stem}-{blake2b(content, digest_size=8).hexdigest()}{path.suffix}"
    _of_views()[name] = Asset(_MEDIA_TYPES[path.suffix], content, {})
    return f"/assets/{name}"


THUMBNAIL = "thumbnail"
"""Segment of the thumbnail of a robot."""


def find_asset(name: str) -> Asset | None:
    """Return the file with this name, of the pages or of views."""
    return assets().files.get(name) or _of_views().get(name)
