"""The contract of pages: the names that other extensions may import of this one (docs/EXTENDING.md)."""

from linked_fleet_gateway.extensions.pages.languages import message, say, translated
from linked_fleet_gateway.extensions.pages.moments import shows_past, timeline_link
from linked_fleet_gateway.extensions.pages.values import Facts, Link, Value
from linked_fleet_gateway.extensions.pages.views import PageView, Part

__all__ = ["Facts", "Link", "PageView", "Part", "Value", "message", "say", "shows_past", "timeline_link", "translated"]
