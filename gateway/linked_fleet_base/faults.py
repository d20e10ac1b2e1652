"""Things that a face of the gateway cannot describe, and parts of extensions that fail.

A face that describes many things guards each of them: an error of one is logged once and noted, the face names the
thing with the reason, and goes on with the others.
"""

import logging
from collections.abc import Container, Iterator
from contextlib import contextmanager
from typing import NamedTuple

log = logging.getLogger(__name__)

MAX_FAULTS = 1_000
_LONGEST = 300  # characters of a reason


class Fault(NamedTuple):
    """A failure in ``part`` of the gateway; ``robot`` is empty if it concerns no single robot."""

    part: str
    robot: str
    reason: str


class Faults:
    """The present faults of one gateway. Beyond MAX_FAULTS the oldest ones are forgotten."""

    def __init__(self) -> None:
        self._known: dict[tuple[str, str, str], Fault] = {}

    @contextmanager
    def guard(self, part: str, robot: str = "", thing: str = "") -> Iterator[None]:
        """Keep an error of the body from ending a face. A success ends the fault.

        ``thing`` tells several bodies about one robot apart.
        """
        try:
            yield
        except Exception as error:  # noqa: BLE001 - whatever one thing raises must not hide the others
            self.note(part, error, robot, thing)
        else:
            self._known.pop((part, robot, thing), None)

    def note(self, part: str, error: Exception, robot: str = "", thing: str = "") -> None:
        """Note a fault, and log it unless it is known already."""
        what = (
            f"{part} cannot describe {f'{thing} of {robot}' if thing else robot}"
            if robot
            else f"{part}: {thing} failed"
        )
        fault = Fault(part, robot, f"{what}: {type(error).__name__}: {error}"[:_LONGEST])
        if self._known.get((part, robot, thing)) == fault:
            return
        # What the system refuses, such as a full disk, is no defect of a program that a traceback would show.
        log.error("%s (logged once)", fault.reason, exc_info=None if isinstance(error, OSError) else error)
        self._known[part, robot, thing] = fault
        if len(self._known) > MAX_FAULTS:
            del self._known[next(iter(self._known))]

    def find(self, part: str, robot: str = "", thing: str = "") -> str:
        """Return the reason of a present fault; empty if there is none."""
        fault = self._known.get((part, robot, thing))
        return "" if fault is None else fault.reason

    def forget_others(self, robots: Container[str]) -> None:
        """Forget the faults of robots that are not among these."""
        for key in [key for key in list(self._known) if key[1] and key[1] not in robots]:
            self._known.pop(key, None)

    @property
    def of_parts(self) -> list[str]:
        """The reasons of the faults that concern no single robot, in order."""
        return sorted(fault.reason for fault in list(self._known.values()) if not fault.robot)

    @property
    def robots(self) -> set[str]:
        """The robots that some face cannot describe."""
        return {fault.robot for fault in list(self._known.values()) if fault.robot}

    def counts(self) -> dict[str, int]:
        """Return the number of faults by part."""
        found: dict[str, int] = {}
        for fault in list(self._known.values()):
            found[fault.part] = found.get(fault.part, 0) + 1
        return found
