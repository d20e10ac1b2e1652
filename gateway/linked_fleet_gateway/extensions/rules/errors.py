"""Errors of the rules.

``TooManyRules`` (429, too-many-rules).
"""

# ruff: noqa: N818  (the names say what is wrong, as those of linked_fleet_gateway.base.errors)

from linked_fleet_gateway.base.errors import FleetError


class TooManyRules(FleetError):
    """The client, or the fleet, has too many rules (RFC 6585, 4)."""

    status, code, title = 429, "too-many-rules", "There are too many rules"
