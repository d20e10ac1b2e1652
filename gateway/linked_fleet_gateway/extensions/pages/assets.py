"""The scripts and styles of the pages, as `face/build` made them: each is named by its content and never changes."""

import json
import logging
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

log = logging.getLogger(__name__)

_FOLDER = Path(__file__).parent / "assets"
_MEDIA_TYPES = {".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml", ".txt": "text/plain"}


@dataclass(frozen=True)
class Assets:
    """``files`` by name, with media type and content; ``entries`` are the names of what pages refer to, by source."""

    files: Mapping[str, tuple[str, bytes]]
    entries: Mapping[str, str]


@cache
def assets() -> Assets:
    """All that there are, read once. Without them, as in a source tree where nothing was built, pages are plain."""
    try:
        entries: dict[str, str] = json.loads((_FOLDER / "manifest.json").read_text(encoding="utf-8"))
    except FileNotFoundError:
        log.warning("the scripts and styles of the pages are not built: make assets")
        return Assets({}, {})
    files = {
        path.name: (_MEDIA_TYPES[path.suffix], path.read_bytes())
        for path in _FOLDER.iterdir()
        if path.suffix in _MEDIA_TYPES
    }
    return Assets(files, entries)
