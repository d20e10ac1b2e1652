"""The activities of invocations, runs of missions, faults, orders and starts of schedules."""

import re

from linked_fleet_gateway.api import Invocation, RequestView, UnprocessableContent, robot_of
from linked_fleet_gateway.extensions.faults.fault import Fault
from linked_fleet_gateway.extensions.missions.record import Run
from linked_fleet_gateway.extensions.notes.note import Note
from linked_fleet_gateway.extensions.queue.order import Order
from linked_fleet_gateway.extensions.queue.reading import deadline_ns
from linked_fleet_gateway.extensions.queue.schedule import Schedule
from linked_fleet_gateway.extensions.timeline.activity import Activity
from linked_fleet_gateway.faces import invocation_path

FLEET = ""
_HUMP = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")


# -- invocations and runs of missions ---------------------------------------------------------------------------------


def ended_before(invocation: Invocation, time_ns: int) -> bool:
    """Return True if an invocation was over before a time, as most are."""
    begin_ns = invocation.started_ns or invocation.created_ns
    return invocation.state.terminal and max(invocation.ended_ns or 0, begin_ns) < time_ns


def of_invocation(view: RequestView, invocation: Invocation) -> Activity:
    """Return the activity of an invocation."""
    begin_ns = invocation.started_ns or invocation.created_ns
    over_ns = invocation.ended_ns or begin_ns
    return Activity(
        invocation.id,
        "action",
        invocation_path(invocation),
        title_of(invocation.action),
        invocation.state.value,
        begin_ns,
        max(over_ns, begin_ns) if invocation.state.terminal else None,
        who=invocation.client,
        robots=_robots_of(view, invocation),
    )


def _robots_of(view: RequestView, invocation: Invocation) -> tuple[str, ...]:
    """Return the robots that an invocation is about, as far as the caller may know of them."""
    if invocation.robot != FLEET:
        return (invocation.robot,)
    told = [each for each in invocation.about if view.visible_robots.includes(each)]
    return tuple(dict.fromkeys([*view.invocations.answers(invocation), *told]))


def title_of(action: str) -> str:
    """Return what an action does, in words, with the part of the robot: ``rotate by elbow_joint``."""
    head, _, name = action.rpartition("/actions/")
    words = _HUMP.sub(" ", name).lower()
    part = head.strip("/").split("/")[1:] if robot_of(action) is not None else []
    return " ".join([words, *part]).removesuffix("~link")


def of_run(id: str, run: Run, robots: tuple[str, ...]) -> Activity:
    """Return the activity of a run of a mission."""
    end_ns = run.ended_ns or None
    who = run.creator.client or run.creator.identity
    return Activity(
        id, "mission", f"/mission-runs/{id}", run.mission.title, run.phase, run.began_ns, end_ns, who=who, robots=robots
    )


# -- faults -----------------------------------------------------------------------------------------------------------


def of_fault(id: str, fault: Fault) -> Activity:
    """Return the activity of a fault: from when its trouble appeared until it was cleared."""
    trouble = fault.trouble
    end_ns = None if fault.is_open else fault.cleared_ns
    return Activity(
        id, "fault", f"/faults/{id}", trouble.says or trouble.kind, fault.state, fault.since_ns, end_ns,
        robots=trouble.robots,
    )  # fmt: skip


# -- notes ------------------------------------------------------------------------------------------------------------


def of_note(id: str, note: Note) -> Activity:
    """Return the activity of a note: the moment at which somebody has written it."""
    at_ns = note.written_ns
    return Activity(
        id, "note", f"/notes/{id}", note.title, "noted", at_ns, at_ns, who=note.by, robots=note.robots
    )  # fmt: skip


# -- orders and schedules ---------------------------------------------------------------------------------------------


def of_order(id: str, order: Order, robots: tuple[str, ...]) -> Activity:
    """Return the activity of an order that has no run: that it waits, or waited."""
    end_ns = order.ended_ns if order.is_over else None
    return Activity(
        id, "order", f"/queue/{id}", order.title, order.state, order.created_ns, end_ns, _deadline(order),
        not order.is_over, order.client, robots,
    )  # fmt: skip


def _deadline(order: Order) -> int | None:
    try:
        return deadline_ns(order.wanted) or None
    except UnprocessableContent:  # kept by a gateway that took other ones
        return None


def of_start(id: str, schedule: Schedule, at_ns: int, robots: tuple[str, ...]) -> Activity:
    """Return the activity of a start of a schedule to come."""
    within_ns = int(schedule.planned.within * 1e9)
    return Activity(
        f"{id}-{at_ns // 10**9}", "schedule", f"/schedules/{id}", schedule.title, "planned", at_ns, at_ns,
        at_ns + within_ns if within_ns else None, True, schedule.client, robots,
    )  # fmt: skip
