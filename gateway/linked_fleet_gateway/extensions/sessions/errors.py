"""Errors of the logins.

``TooManyLogins`` (429, too-many-logins).
"""

# ruff: noqa: N818  (the names say what is wrong, as those of linked_fleet_gateway.base.errors)

from linked_fleet_gateway.base.errors import FleetError


class TooManyLogins(FleetError):
    """Too many logins of one address failed; further failures must wait as long as ``Retry-After`` says."""

    status, code, title = 429, "too-many-logins", "Too many attempts to log in"

    def __init__(self, detail: str, *, retry_after_s: int) -> None:
        super().__init__(detail, headers={"Retry-After": str(retry_after_s)})
