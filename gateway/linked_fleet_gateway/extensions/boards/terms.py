"""The terms of boards."""

from linked_fleet_gateway.api import LF as CORE

LF = CORE.extended("Board BoardList BoardInput BoardShape boards boardLine")
