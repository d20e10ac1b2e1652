"""A goal of ROS carried out as a run of an action of a component."""

import asyncio
from collections.abc import Callable, Collection, Mapping
from typing import Any

from linked_fleet_agent.components.call import Call
from linked_fleet_agent.robots.ros2.goals import SUCCEEDED, ActionClient, GoalEnd, GoalError, goal_id_of

_FEEDBACK_S = 0.1
_ENDS = {5: "was cancelled by another client of ROS", 6: "was given up by the robot"}


async def run_goal(
    call: Call[Any],
    client: ActionClient,
    goal: Mapping[str, Any],
    tell: Callable[[dict[str, Any]], None],
    accepted: Collection[int] = (SUCCEEDED,),
) -> GoalEnd:
    """Carry out a goal until it ends, with one of these statuses, and cancel it together with the action.

    ``tell`` is called with the newest feedback, ten times a second at most. Raises ValueError with what went wrong.
    """
    goal_id = goal_id_of(call.id)
    ending: asyncio.Task[GoalEnd] | None = None
    try:
        await client.send(goal_id, goal)
        ending = asyncio.ensure_future(client.result(goal_id))
        while not ending.done():
            await asyncio.wait({ending}, timeout=_FEEDBACK_S)
            if (said := client.feedback(goal_id)) is not None:
                tell(said)
        end = ending.result()
    except GoalError as error:
        raise ValueError(str(error)) from error
    except asyncio.CancelledError:
        if ending is not None and not call.goes_on:
            await _cancel(client, goal_id, ending)
        raise
    if end.status not in accepted:
        raise ValueError(f"it {_ENDS.get(end.status, 'has failed')}{_why(end.result)}")
    return end


async def _cancel(client: ActionClient, goal_id: bytes, ending: "asyncio.Task[GoalEnd]") -> None:
    """Cancel a goal, and wait until it has ended: only then does the robot stand."""
    try:
        await client.cancel(goal_id)
        await ending
    except GoalError as error:
        raise ValueError(f"it was not cancelled: {error}") from error


def _why(result: Mapping[str, Any]) -> str:
    """Return what a result says beside its status, as those of Nav2 and of controllers do."""
    code = result.get("error_code", 0)
    said = result.get("error_msg", "") or result.get("error_string", "") or result.get("message", "")
    return (f": error {code}" if code else "") + (f" ({said[:300]})" if isinstance(said, str) and said else "")
