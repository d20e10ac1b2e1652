"""The terms of faults."""

from linked_fleet_gateway.api import LF as CORE

LF = CORE.extended(
    "Fault FaultList FaultShape FaultListShape FaultState Severity AcknowledgeFault RemarkFault ClearFault RaiseFault"
    " faults faultKind about severity since lastRaised count present latched acknowledgedBy acknowledgedAt clearedBy"
    " clearedAt remark evidence recording valuesThen openFaults worstSeverity trouble"
    " faultRaised faultConfirmed faultAcknowledged faultCleared information warning error critical"
)
STATES = {
    "raised": LF.faultRaised, "confirmed": LF.faultConfirmed, "acknowledged": LF.faultAcknowledged,
    "cleared": LF.faultCleared,
}  # fmt: skip
