"""The interface for pages: an extension may render resources and problems as HTML."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from pyoxigraph import Triple

from linked_fleet_base.errors import FleetError
from linked_fleet_gateway.resources.resource import Resource

HTML = "text/html"
Formats = Mapping[str, tuple[str, str]]
"""Label and media type of each representation, by its word in ``?as=``."""


@dataclass(frozen=True)
class NavigationEntry:
    """A link on all pages, ordered by ``rank``; the fleet has 0.

    ``restricted``: only readers who have one of the rights in ``FleetBranch.reading`` of its branch get the link.
    ``for_developers``: it stands with the formats at the foot of pages.
    """

    title: str
    path: str
    rank: int = 50
    restricted: bool = False
    for_developers: bool = False


@dataclass(frozen=True)
class Reader:
    """The reader of a page.

    ``name``: that of the person who has logged in, else empty. ``rights``: over the resource of the page, None if
    authentication is off. ``restricted_paths``: those of restricted branches (``FleetBranch.reading``) that the reader
    may read. ``languages``: those that the reader prefers, as in Accept-Language; a chosen one is the first.
    """

    name: str = ""
    rights: tuple[str, ...] | None = None
    restricted_paths: tuple[str, ...] = ()
    languages: str = ""


NOBODY = Reader()


@dataclass(frozen=True)
class PageContext:
    """The part of a page that is not about its resource."""

    reader: Reader = NOBODY
    query: str = ""
    """The query of the request, which links to other representations repeat."""
    links_subscriptions: bool = True
    """True if the page links the Subscriptions container, which not every reader of the page may read."""
    warning: str = ""
    """A sentence about the gateway."""


Context = Callable[[], PageContext]
"""Returns the context of a page; called for pages only."""


class HtmlWriter(Protocol):
    modules: Sequence[str]
    """Modules that are slow to import and needed for pages only."""

    def prepare(self) -> None:
        """Load what the first page needs besides; called in a thread when the modules are loaded."""

    def write_resource(
        self, resource: Resource, triples: Sequence[Triple], base: str, formats: Formats, context: PageContext
    ) -> bytes:
        """Return the page of a resource; ``base`` is scheme and authority."""

    def write_problem(
        self, error: FleetError, instance: str | None, report: Sequence[Mapping[str, str]], reader: Reader | None
    ) -> bytes:
        """Return the page of an error; ``report`` has the results of a SHACL report.

        ``reader`` is None as long as nobody knows who asks.
        """

    def language(self, reader: Reader) -> str:
        """Return the tag of the language in which ``reader`` gets pages."""

    def content_security_policy(self, forms: bool) -> str:
        """Return the Content-Security-Policy of a page; ``forms`` permits submitting forms without a script."""
