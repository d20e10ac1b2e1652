"""The contract of pages: what other extensions may import of this one (docs/EXTENDING.md, "A page")."""

from linked_fleet_gateway.extensions.pages.values import Facts, Link, Value
from linked_fleet_gateway.extensions.pages.views import PageView, Part

__all__ = ["Facts", "Link", "PageView", "Part", "Value"]
