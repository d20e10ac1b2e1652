"""The terms of people."""

from linked_fleet_gateway.api import LF as CORE

LF = CORE.extended(
    "People Person ControlRequests ControlRequest ControlRequestInput HandOverControl RefuseControl controlToken asker"
    " askingSince controls hereSince answeredBy controlAsked controlGranted controlRefused people"
)
