"""The folder of recordings: a folder for each robot, with files named by time and id of their occasion.

Gateways may share it: each of them would write the same file, and none removes what another is writing.
"""

import fcntl
import hashlib
import logging
import os
import re
import secrets
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from uuid import UUID

from linked_fleet_base.lazy_imports import LazyModule
from linked_fleet_rdf.serialise import NoContentYet

if TYPE_CHECKING:
    from mcap import reader as mcap
else:
    mcap = LazyModule("mcap.reader")

log = logging.getLogger(__name__)

_UNFINISHED = ".new"
_MOST_SAID = 1000
_NAME = re.compile(r"[0-9]{20}-[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}", re.ASCII)


@dataclass(frozen=True)
class Recorded:
    """A file: what happened, the length of what was recorded, and its size. ``says`` is empty if it cannot be read."""

    path: Path
    says: str
    length_s: float
    size: int

    @property
    def at_ns(self) -> int:
        return int(self.path.stem.partition("-")[0])

    def read(self) -> bytes:
        """Return its content. Raises NoContentYet."""
        try:
            return self.path.read_bytes()
        except OSError as error:
            raise NoContentYet(f"the recording cannot be read: {error.strerror}") from error


def folder_name(robot: str) -> str:
    """Return a folder name for a robot, whose name may be long and contain anything."""
    return hashlib.sha256(robot.encode()).hexdigest()


def file_path(folder: Path, robot: str, at_ns: int, id: str) -> Path:
    """Return the same path at each gateway, because gateways that share the folder record the same occasions."""
    return folder / folder_name(robot) / f"{at_ns:020}-{UUID(id)}.mcap"


def look_up(folder: Path) -> dict[str, dict[str, Recorded]]:
    """Return the recordings by the name of their robot's folder and by id, the oldest first."""
    found: dict[str, dict[str, Recorded]] = {}
    for path in sorted(folder.glob("*/*.mcap")):
        if not _NAME.fullmatch(path.stem):
            continue  # what somebody has put there is no recording of this gateway
        found.setdefault(path.parent.name, {})[path.stem.partition("-")[2]] = _recorded(path)
    return found


def _recorded(path: Path) -> Recorded:
    try:
        with path.open("rb") as file:
            reader = mcap.make_reader(file)
            summary = reader.get_summary()
            statistics = None if summary is None else summary.statistics
            length_ns = 0 if statistics is None else statistics.message_end_time - statistics.message_start_time
            says = next((str(each.metadata.get("says", "")) for each in reader.iter_metadata()), "")
        return Recorded(path, says[:_MOST_SAID], max(0, length_ns) / 1e9, path.stat().st_size)
    except Exception as error:  # noqa: BLE001 - a damaged file may raise anything, and costs no other recording
        log.warning("the recording %s cannot be read: %s", path.name, error)
        return Recorded(path, "", 0.0, 0)


def write(path: Path, content: bytes) -> None:
    """Write in one step, so that no file is ever incomplete. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    new = path.with_name(f"{path.stem}-{secrets.token_hex(4)}{_UNFINISHED}")
    with _locked(path.parent, fcntl.LOCK_SH):
        try:
            new.write_bytes(content)
            new.replace(path)
        except OSError:
            new.unlink(missing_ok=True)
            raise


@contextmanager
def _locked(folder: Path, mode: int) -> Iterator[None]:
    """Lock a robot's folder: shared while a gateway writes into it, alone while what others left is removed."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, mode)
        yield
    finally:
        os.close(descriptor)


def remove_unfinished(recordings: Path) -> None:
    """Remove what killed gateways had begun to write, except where another gateway is writing now."""
    for folder in {path.parent for path in recordings.glob(f"*/*{_UNFINISHED}")}:
        try:
            with _locked(folder, fcntl.LOCK_EX | fcntl.LOCK_NB):
                for path in folder.glob(f"*{_UNFINISHED}"):
                    path.unlink(missing_ok=True)
        except BlockingIOError:
            continue  # the next start will find it
        except OSError as error:
            log.warning("an unfinished recording cannot be removed: %s", error)


def remove(recordings: Iterable[Recorded]) -> None:
    for each in recordings:
        try:
            each.path.unlink(missing_ok=True)
        except OSError as error:
            log.warning("an old recording cannot be removed: %s", error)
