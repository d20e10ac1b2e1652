"""Troubles of what is done: failed motions, actions and stops. Pure.

What a gateway or an agent refuses because of the request is the mistake of its client, and no fault.
"""

from collections.abc import Mapping

from linked_fleet_gateway.api import Invocation, InvocationState, robot_path
from linked_fleet_gateway.extensions.faults.fault import MOST_SAYS, Trouble
from linked_fleet_gateway.faces import invocation_path

_OWN_FAULT = frozenset({"", "fault"})
"""Refusals of agents that tell of their robot instead of the request; empty for a motion that has begun."""
RUN = "/actions/run"


def of_invocation(invocation: Invocation) -> Trouble | None:
    """Return the trouble that the end of an invocation of robots tells of; None if there is none."""
    if invocation.state is not InvocationState.FAILED or invocation.refused not in _OWN_FAULT:
        return None
    robots = (invocation.robot,) if invocation.robot else tuple(sorted(invocation.robots))
    if not robots:
        return None
    is_stop = invocation.stops is not None
    kind = "stop-failed" if is_stop else "motion-failed" if invocation.is_motion else "action-failed"
    name = invocation.action.rpartition("/")[2]
    return Trouble(
        kind,
        robot_path(invocation.robot) if invocation.robot else "/",
        robots,
        "critical" if is_stop else "error" if invocation.is_motion else "warning",
        f"{name} failed: {invocation.reason or 'no reason is known'}"[:MOST_SAYS],
        event=True,
        values=_values(invocation.result),
        invocation=invocation_path(invocation),
    )


def of_mission(invocation: Invocation, mission: str, robots: tuple[str, ...]) -> Trouble | None:
    """Return the trouble that the end of a run of a mission tells of; None if there is none."""
    if invocation.state is not InvocationState.FAILED:
        return None
    says = f"{mission} failed: {invocation.reason or 'no reason is known'}"[:MOST_SAYS]
    place = invocation.action.removesuffix(RUN)
    return Trouble("mission-failed", place, robots, "error", says, event=True, invocation=invocation_path(invocation))


def _values(positions: Mapping[str, float]) -> dict[str, str]:
    return {name: f"{value:.4g}" for name, value in list(positions.items())[:32]}
