"""The terms of the queue."""

from linked_fleet_gateway.extensions.missions.terms import LF as MISSIONS

LF = MISSIONS.extended(
    "Queue QueuedOrder OrderInput OrderShape QueueShape queue RobotChoice choice forParameter candidate componentKind"
    " offersKind select nearPoint batteryNeed deadline rank missed chosen reservedRobot missionRun fromSchedule"
    " orderedBy MoveOrder MoveInput WithdrawOrder beforeOrder afterOrder"
    " Schedule ScheduleList ScheduleInput ScheduleShape ScheduleListShape schedules orderTemplate recurrenceRule"
    " startsAt timeZone isActive nextStart startWithin lastOrder missedStart missedStarts MissedStart"
)
