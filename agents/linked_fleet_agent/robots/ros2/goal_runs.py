"""A goal of ROS carried out as a run of an action of a component."""

import asyncio
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from typing import Any

from linked_fleet_agent.components.call import Call, EndUnknownError
from linked_fleet_agent.robots.ros2.goals import SUCCEEDED, ActionClient, GoalEnd, GoalError, goal_id_of
from linked_fleet_agent.robots.ros2.types import MessageType

_FEEDBACK_S, _AGAIN_S = 0.1, 0.5
_ENDS = {5: "was cancelled by another client of ROS", 6: "was given up by the robot"}
Tell = Callable[[dict[str, Any]], None]


async def run_goal(
    call: Call[Any], client: ActionClient, goal: Mapping[str, Any], tell: Tell, accepted: Collection[int] = (SUCCEEDED,)
) -> GoalEnd:
    """Carry out a goal until it ends, with one of these statuses, and cancel it together with the action.

    ``tell`` is called with the newest feedback, ten times a second at most. Raises ValueError with what went wrong, and
    EndUnknownError if it was cancelled and the server does not say that it has ended.
    """
    goal_id = goal_id_of(call.id)
    try:
        await client.send(goal_id, goal)
    except GoalError as error:
        raise ValueError(str(error)) from error
    except asyncio.CancelledError:
        if not call.goes_on:
            await _cancel(client, goal_id)  # the server may have it
        raise
    return await follow_goal(call, client, tell, accepted)


async def follow_goal(
    call: Call[Any], client: ActionClient, tell: Tell, accepted: Collection[int] = (SUCCEEDED,)
) -> GoalEnd:
    """Wait for the end of a goal that the server has, perhaps since an earlier run of this agent, as ``run_goal``."""
    goal_id = goal_id_of(call.id)
    client.listen()
    ending = asyncio.ensure_future(client.result(goal_id))
    try:
        while not ending.done():
            await asyncio.wait({ending}, timeout=_FEEDBACK_S)
            if (said := client.feedback(goal_id)) is not None:
                tell(said)
        end = ending.result()
    except GoalError as error:
        raise ValueError(str(error)) from error
    except asyncio.CancelledError:
        if not call.goes_on:
            await _cancel(client, goal_id)
        raise
    finally:
        ending.cancel()
    if end.status not in accepted:
        raise ValueError(f"it {_ENDS.get(end.status, 'has failed')}{_why(end.result, client.type.result)}")
    return end


async def _cancel(client: ActionClient, goal_id: bytes) -> None:
    """Cancel a goal, again and again, until it has ended: only then does the robot stand. Raises EndUnknownError."""
    ending = asyncio.ensure_future(client.result(goal_id))
    try:
        while not ending.done():
            with suppress(GoalError):
                await client.cancel(goal_id)
            await asyncio.wait({ending}, timeout=_AGAIN_S)
        ending.result()
    except GoalError as error:
        raise EndUnknownError(f"it was cancelled, and {error}") from error
    finally:
        ending.cancel()


def _why(result: Mapping[str, Any], type: MessageType) -> str:
    """Return what a result says beside its status, as those of Nav2 and of controllers do."""
    code = result.get("error_code", 0)
    name = next((f", {name}" for name, value in type.constants.items() if value == code), "")
    texts = (result.get(each) for each in ("error_msg", "error_string", "message"))
    said = next((text for text in texts if isinstance(text, str) and text), "")
    return (f": error {code}{name}" if code else "") + (f" ({said[:300]})" if said else "")
