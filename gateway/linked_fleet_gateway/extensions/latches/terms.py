"""The terms of stop latches."""

from linked_fleet_gateway.api import LF as CORE

LF = CORE.extended("StopLatch StopLatchList StopLatchInput StopLatchShape stopLatches latchAbout latchedBy notLatched")
