"""Data that the embedded server cannot load. It is renamed and kept, never deleted."""

import shutil
import time
from pathlib import Path

DATA = "appendonlydir"
"""Folder of the append-only file, as Valkey names it."""
_DAMAGED = f"{DATA}.damaged-"
_MANIFEST = "appendonly.aof.manifest"


def lacks_manifest(state_dir: Path) -> bool:
    """Return True for data files without a manifest, which Valkey would silently ignore and start empty.

    The server writes its first data file before the manifest; that file is still empty.
    """
    data = state_dir / DATA
    return any(data.glob("*.incr.aof")) and not (data / _MANIFEST).exists()


def move_damaged_data(state_dir: Path) -> Path | None:
    """Rename the data folder. Return its new path, or None if there is none. Raises OSError."""
    data = state_dir / DATA
    stamp = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime())
    names = (f"{_DAMAGED}{stamp}{suffix}" for suffix in ("", *(f"-{number}" for number in range(1, 1000))))
    target = next(path for name in names if not (path := state_dir / name).exists())
    try:
        return data.rename(target)
    except FileNotFoundError:
        return None


def restore_data(state_dir: Path, aside: Path) -> None:
    """Undo ``move_damaged_data``. Data of a server that started but never served is deleted. Raises OSError."""
    shutil.rmtree(state_dir / DATA, ignore_errors=True)
    aside.rename(state_dir / DATA)


def damaged_copies(state_dir: Path) -> tuple[str, ...]:
    """Return the names of the folders set aside that still exist, oldest first. Raises OSError."""
    return tuple(sorted(path.name for path in state_dir.iterdir() if path.name.startswith(_DAMAGED)))


def damage_warning(names: tuple[str, ...], contents: str) -> str:
    """Return a warning that names the folders with damaged data, and their contents; empty if there are none."""
    if not names:
        return ""
    return (
        f"The embedded server could not load its data and started without them. They are kept in the state folder as "
        f"{', '.join(names)}. Forgotten are {contents}. Delete or move that folder to end this warning."
    )
