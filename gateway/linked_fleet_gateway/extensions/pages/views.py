"""Page views: a template and a function for each kind of resource. Other extensions add theirs."""

from collections.abc import Callable, Mapping, Set
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pyoxigraph import NamedNode

from linked_fleet_gateway.extensions.pages.values import Facts
from linked_fleet_gateway.rdf.turtle import Subject


@dataclass(frozen=True)
class Part:
    """What a view contributes to a page.

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

    ``constants``: values by name for views of other extensions, such as the path of a container.
    """

    type: NamedNode
    template: Path
    read: Callable[[Facts, NamedNode], Part]
    constants: Mapping[str, str] = field(default_factory=dict)

    @property
    def kind(self) -> str:
        return self.template.stem


_added: dict[NamedNode, PageView] = {}


def add_view(view: PageView) -> None:
    """Show resources of a class by this view in this process."""
    _added[view.type] = view


def added_views() -> list[PageView]:
    return list(_added.values())


def constant(name: str) -> str:
    """Return the value that an added view gives this name; empty if there is none."""
    return next((each.constants[name] for each in _added.values() if name in each.constants), "")
