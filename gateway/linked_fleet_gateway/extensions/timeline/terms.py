"""The terms of timelines."""

from linked_fleet_gateway.api import LF as CORE
from linked_fleet_gateway.api import NamedNode

LF = CORE.extended(
    "Timeline TimelineShape TimelineActivity TimelineActivityShape timeline windowStart windowEnd asOf activity"
    " activityKind activityOf leftOut completeFrom completeUntil shownRobot robotsLeftOut plannedStart latestStart"
    " planned noted starting missed paused blocked ending faultRaised faultConfirmed faultAcknowledged faultCleared"
)
_OF_FAULTS = {
    "raised": LF.faultRaised, "confirmed": LF.faultConfirmed, "acknowledged": LF.faultAcknowledged,
    "cleared": LF.faultCleared,
}  # fmt: skip


def state_term(state: str) -> NamedNode:
    """Return the term of the state of an activity."""
    return _OF_FAULTS.get(state) or LF.terms[state]
