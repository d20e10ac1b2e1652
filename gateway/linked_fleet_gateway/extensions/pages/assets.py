"""The scripts and styles of the pages, as built by `scripts/build`: each is named by its content and never changes."""

import json
import logging
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

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
    """``files`` by name. ``entries``: the names of files that pages refer to, by source."""

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
