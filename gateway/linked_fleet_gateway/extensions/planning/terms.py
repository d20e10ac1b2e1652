"""The terms of the extension."""

from linked_fleet_rdf.vocabulary import LF as CORE

LF = CORE.extended(
    "PathKind Direct Planned Straight path plan ofLink tip upright axis stayIn lower upper tipSpeed leastManipulability"
)
