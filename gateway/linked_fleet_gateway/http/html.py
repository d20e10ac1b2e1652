"""The seam towards pages: an extension may write resources and problems as HTML."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from pyoxigraph import Triple

from linked_fleet_gateway.base.errors import FleetError
from linked_fleet_gateway.resources.resource import Resource

HTML = "text/html"
Formats = Mapping[str, tuple[str, str]]
"""Label and media type of each representation, by the word that picks it in ``?as=``."""


@dataclass(frozen=True)
class NavigationEntry:
    """A link that all pages have. Entries stand in the order of ``rank``; the fleet has 0, the audit 90."""

    title: str
    path: str
    rank: int = 50


class HtmlWriter(Protocol):
    modules: Sequence[str]
    """Modules that take long to import, and that only pages need."""

    def write_resource(self, resource: Resource, triples: Sequence[Triple], base: str, formats: Formats) -> bytes:
        """The page of a resource; ``base`` is scheme and authority."""

    def write_problem(self, error: FleetError, instance: str | None, report: Sequence[Mapping[str, str]]) -> bytes:
        """The page of an error; ``report`` has the results of a SHACL report."""

    def policy(self, forms: bool) -> str:
        """The Content-Security-Policy of a page; ``forms``: it sends forms without a script."""
