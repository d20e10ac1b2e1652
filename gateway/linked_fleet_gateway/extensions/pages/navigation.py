"""The navigation of all pages: the fleet, entries of enabled extensions, and the audit."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from linked_fleet_gateway.http.html import NavigationEntry
from linked_fleet_gateway.resources.paths import AUDIT

_FLEET = NavigationEntry("Fleet", "/", 0)
_AUDIT = NavigationEntry("Audit", AUDIT, 90)
_entries: tuple[NavigationEntry, ...] = ()


@dataclass(frozen=True)
class Place:
    """An entry on a page. ``current``: the value of aria-current: empty, ``page``, or ``true`` for a page below."""

    title: str
    href: str
    current: str = ""


def set_entries(entries: Iterable[NavigationEntry]) -> None:
    """Set the extensions' entries for the pages of this process."""
    global _entries
    _entries = tuple(entries)


def places(
    path: str | None = None,
    audited: bool = False,
    entries: Iterable[NavigationEntry] | None = None,
    root: str = "/",
) -> list[Place]:
    """Return the ordered entries for the page at ``path``; ``audited``: whether the reader may read the audit.

    ``entries``: those of extensions, if not set in this process; ``root``: the address of the fleet.
    """
    added = _entries if entries is None else entries
    shown = sorted([_FLEET, *added, *([_AUDIT] if audited else [])], key=lambda each: each.rank)
    here = _section(path, shown)
    return [Place(each.title, root + each.path[1:], _current(path, each) if each is here else "") for each in shown]


def _section(path: str | None, entries: Sequence[NavigationEntry]) -> NavigationEntry | None:
    """Return the entry at or above the page; robots belong to the fleet."""
    if path is None:
        return None
    below = (each for each in entries if path == each.path or path.startswith(each.path + "/"))
    return next(below, _FLEET)


def _current(path: str | None, entry: NavigationEntry) -> str:
    return "page" if path == entry.path else "true"
