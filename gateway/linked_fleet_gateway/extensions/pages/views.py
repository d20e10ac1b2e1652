"""Views and navigation of pages, to which other extensions add theirs, and terms of extensions that pages look for.

A view is a template and a function for one kind of resource. The navigation of all pages has the fleet, entries of
enabled extensions.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pyoxigraph import NamedNode

from linked_fleet_base.contributions import present
from linked_fleet_gateway.extensions.pages.assets import add_file
from linked_fleet_gateway.extensions.pages.languages import known, message
from linked_fleet_gateway.extensions.pages.values import Facts
from linked_fleet_gateway.faces import NavigationEntry
from linked_fleet_rdf.turtle import Subject
from linked_fleet_rdf.vocabulary import LF as CORE

LF = CORE.extended(
    "Audit Directory Invitations Model People cameras history model notesOfRobot placement savedPoses world"
)


@dataclass(frozen=True)
class Part:
    """The contribution of a view to a page.

    ``more``: variables for the template. ``shown``: predicates of the resource that it displays; ``done``: other
    subjects that it displays. ``title``: the heading, if better than the resource's own.
    """

    more: Mapping[str, Any] = field(default_factory=dict)
    shown: Set[NamedNode] = frozenset()
    done: Set[Subject] = frozenset()
    title: str = ""


@dataclass(frozen=True)
class PageView:
    """The view of resources of one class; ``template`` is a file whose name is the kind of page.

    ``constants``: values by name for views of other extensions, such as the path of a container. ``files``: ready-made
    scripts (ES modules, ``.js``) and styles (``.css``) of these pages, which may load nothing from other sites.
    ``help``: a message that says what the page is for, and what one can do on it. ``guide``: the address of a page of
    documentation, or a path in that of this project.
    """

    type: NamedNode
    template: Path
    read: Callable[[Facts, NamedNode], Part]
    constants: Mapping[str, str] = field(default_factory=dict)
    files: tuple[Path, ...] = ()
    help: str = ""
    guide: str = ""

    @property
    def kind(self) -> str:
        return self.template.stem


@dataclass
class _Added:
    """The additions of extensions to the pages of one gateway."""

    views: dict[NamedNode, PageView] = field(default_factory=dict)
    files: dict[NamedNode, Sequence[str]] = field(default_factory=dict)
    entries: tuple[NavigationEntry, ...] = ()


def _added() -> _Added:
    return present().derived("pages", _Added)


def add_view(view: PageView) -> None:
    """Show resources of a class by this view. Raises OSError, ValueError for a file of the view."""
    _added().files[view.type] = [add_file(each) for each in view.files]
    _added().views[view.type] = view


def files_of(view: PageView) -> Sequence[str]:
    """Return the addresses of the files of an added view."""
    return _added().files.get(view.type, ())


def checked_view(view: object) -> PageView:
    """Return a view of an extension. Raises TypeError if it is none."""
    if not isinstance(view, PageView):
        raise TypeError(f"a view is a PageView, not {view!r:.80}")
    return view


def added_views() -> list[PageView]:
    return list(_added().views.values())


def constant(name: str) -> str:
    """Return the value that an added view gives this name; empty if there is none."""
    return next((each.constants[name] for each in _added().views.values() if name in each.constants), "")


_FLEET = NavigationEntry(message("Fleet"), "/", 0)


@dataclass(frozen=True)
class Place:
    """An entry on a page. ``current``: the value of aria-current: empty, ``page``, or ``true`` for a page below.

    ``path`` is that of the page, which is the same in all languages.
    """

    title: str
    href: str
    current: str = ""
    path: str = ""


def set_entries(entries: Iterable[NavigationEntry]) -> None:
    """Set the extensions' entries for all pages."""
    _added().entries = tuple(entries)


def places(
    path: str | None = None,
    restricted_paths: Collection[str] = (),
    entries: Iterable[NavigationEntry] | None = None,
    root: str = "/",
    for_developers: bool = False,
) -> list[Place]:
    """Return the ordered entries for the page at ``path``; ``restricted_paths``: those of restricted entries
    that the reader may read.

    ``entries``: those of extensions, if not set before; ``root``: the address of the fleet; ``for_developers``: those
    at the foot of the page instead of those in its bar.
    """
    added = _added().entries if entries is None else entries
    wanted = [each for each in (_FLEET, *added) if each.for_developers == for_developers]
    readable = [each for each in wanted if not each.restricted or each.path in restricted_paths]
    shown = sorted(readable, key=lambda each: each.rank)
    here = _section(path, shown)
    return [
        Place(known(each.title), root + each.path[1:], _current(path, each) if each is here else "", each.path)
        for each in shown
    ]


def _section(path: str | None, entries: Sequence[NavigationEntry]) -> NavigationEntry | None:
    """Return the entry at or above the page; robots belong to the fleet."""
    if path is None:
        return None
    below = (each for each in entries if path == each.path or path.startswith(each.path + "/"))
    return next(below, _FLEET)


def _current(path: str | None, entry: NavigationEntry) -> str:
    return "page" if path == entry.path else "true"
