"""Terms of the core, and those of other extensions that pages look for."""

from linked_fleet_gateway.rdf.vocabulary import LF as CORE

LF = CORE.extended("Directory cameras history placement world")
