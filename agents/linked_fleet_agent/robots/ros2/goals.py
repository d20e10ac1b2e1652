"""Clients of ROS actions: goals, their feedback and result, and their cancellation (ROS 2 design, "Actions").

Every wait is bounded, but that for a result, which lasts as long as the server says that it works on the goal.
"""

import asyncio
import time
import uuid
from collections.abc import Awaitable, Mapping
from typing import Any, NamedTuple, TypeVar

from linked_fleet_agent.robots.ros2.definitions import DefinitionError
from linked_fleet_agent.robots.ros2.graph import CallError, Graph, Interface
from linked_fleet_agent.robots.ros2.inbox import Inbox
from linked_fleet_agent.robots.ros2.serialization import CdrError
from linked_fleet_agent.robots.ros2.services import hash_of
from linked_fleet_agent.robots.ros2.types import ActionType, MessageTypes, ServiceType

EXECUTING, SUCCEEDED, CANCELED, ABORTED = 2, 4, 5, 6  # action_msgs/msg/GoalStatus
_WORKING = (1, EXECUTING, 3)  # accepted, executing, canceling
_ENDED = (SUCCEEDED, CANCELED, ABORTED)
CANCEL_GOAL, STATUS_ARRAY = "action_msgs/srv/CancelGoal", "action_msgs/msg/GoalStatusArray"
ANSWER_S = 2.0
"""Longest wait until a server accepts a goal, or a cancellation."""
RESULT_S, LOST_S = 30.0, 15.0
"""A result is asked for anew after the first time, and given up when no server was there for the second one."""
MAX_RESULT_BYTES = 1_048_576
_MOST_GOALS, _PAUSE_S = 64, 0.2
_ALL = bytes(16)
T = TypeVar("T")


class GoalError(Exception):
    """A goal was not sent, or what became of it is not known; the message says which."""


class GoalRefusedError(GoalError):
    """The server does not accept the goal."""


class GoalLostError(GoalError):
    """The server does not know the goal, as after its restart."""


class GoalEnd(NamedTuple):
    """The end of a goal: ``SUCCEEDED``, ``CANCELED`` or ``ABORTED``, and its result."""

    status: int
    result: dict[str, Any]


def goal_id_of(id: str) -> bytes:
    """Return the id of the goal of an invocation: its own, if it is a UUID, so that the goal can be found again."""
    try:
        return uuid.UUID(id).bytes
    except ValueError:
        return uuid.uuid5(uuid.NAMESPACE_URL, id).bytes


class ActionClient:
    """A client of one action. Raises DefinitionError if its type is not known."""

    def __init__(self, graph: Graph, types: MessageTypes, name: str, type: str) -> None:
        self.name, self.type_name, self._graph = name, type, graph
        self.type: ActionType = types.action(type, self._stated_hashes(type))
        self._cancel = types.service(CANCEL_GOAL)
        self._feedback: Inbox | None = None
        self._newest = dict[bytes, dict[str, Any]]()
        self._status = Inbox(graph, f"{name}/_action/status", types.message(STATUS_ARRAY), latched=True)
        self._goals = dict[bytes, int]()

    @property
    def is_available(self) -> bool:
        """True if a node offers the action."""
        wanted = f"{self.name}/_action/send_goal"
        return any(each.role == "service" and each.interface.name == wanted for each in self._graph.offers())

    async def send(self, goal_id: bytes, goal: Mapping[str, Any]) -> None:
        """Send a goal. Raises GoalRefusedError, or GoalError if it is not known whether the server has it."""
        self.listen()
        request = {"goal_id": {"uuid": goal_id}, "goal": goal}
        answer = await self._within(self._call("send_goal", self.type.send_goal, request), "does not answer")
        if not answer["accepted"]:
            raise GoalRefusedError(f"{self.name} does not accept the goal")

    def listen(self) -> None:
        """Receive feedback from now on."""
        if self._feedback is None:
            self._feedback = Inbox(self._graph, f"{self.name}/_action/feedback", self.type.feedback_message)

    def feedback(self, goal_id: bytes) -> dict[str, Any] | None:
        """Return the newest feedback of a goal, once; None if there is no new one."""
        for said in self._feedback.fetch() if self._feedback is not None else ():
            self._newest[bytes(said["goal_id"]["uuid"])] = said["feedback"]
            while len(self._newest) > _MOST_GOALS:
                del self._newest[next(iter(self._newest))]
        return self._newest.pop(goal_id, None)

    def status(self, goal_id: bytes) -> int | None:
        """Return the status of a goal as the server has published it last; None if it does not name the goal."""
        return self.statuses().get(goal_id)

    def statuses(self) -> Mapping[bytes, int]:
        """Return the goals that the server has and had lately, of all its clients, as it has published it last."""
        for said in self._status.fetch():
            self._goals = {bytes(each["goal_info"]["goal_id"]["uuid"]): each["status"] for each in said["status_list"]}
        return self._goals

    async def result(self, goal_id: bytes) -> GoalEnd:
        """Wait for the end of a goal, also across restarts of what is between. Raises GoalError if it is not known."""
        seen_s = time.monotonic()
        while True:
            try:
                end = await self._result_now(goal_id)
            except GoalError as error:
                if self.is_available and self.status(goal_id) in _WORKING and not isinstance(error, GoalLostError):
                    seen_s = time.monotonic()  # the transport has ended the call
                elif isinstance(error, GoalLostError) or time.monotonic() - seen_s > LOST_S:
                    raise GoalError(f"what became of the goal is not known: {error}") from error
                await asyncio.sleep(_PAUSE_S)
                continue
            if end is not None:
                return end
            seen_s = time.monotonic()

    async def cancel(self, goal_id: bytes) -> bool:
        """Cancel a goal. Return True if the server ends it. Raises GoalError."""
        return bool(await self._cancelled(goal_id))

    async def cancel_all(self) -> list[bytes]:
        """Cancel all goals, also those of other clients. Return which the server ends. Raises GoalError."""
        return await self._cancelled(_ALL)

    async def _result_now(self, goal_id: bytes) -> GoalEnd | None:
        """Return the result, or None if the server has not ended the goal within ``RESULT_S``."""
        asking = asyncio.ensure_future(self._call("get_result", self.type.get_result, {"goal_id": {"uuid": goal_id}}))
        try:
            ended_s = begun_s = time.monotonic()
            while time.monotonic() - begun_s < RESULT_S:
                done, _ = await asyncio.wait({asking}, timeout=_PAUSE_S)
                if done:
                    return self._end(asking.result())
                if self.status(goal_id) not in _ENDED:
                    ended_s = time.monotonic()
                elif time.monotonic() - ended_s > ANSWER_S:
                    return None  # the answer was lost on its way
            return None
        finally:
            asking.cancel()

    def _end(self, answer: Mapping[str, Any]) -> GoalEnd:
        if answer["status"] not in _ENDED:
            raise GoalLostError(f"{self.name} does not know the goal any more")
        return GoalEnd(answer["status"], answer["result"])

    async def _cancelled(self, goal_id: bytes) -> list[bytes]:
        request = {"goal_info": {"goal_id": {"uuid": goal_id}}}
        answer = await self._within(self._call("cancel_goal", self._cancel, request), "does not answer a cancellation")
        return [bytes(each["goal_id"]["uuid"]) for each in answer["goals_canceling"]]

    async def _within(self, call: Awaitable[T], otherwise: str) -> T:
        try:
            async with asyncio.timeout(ANSWER_S):
                return await call
        except TimeoutError:
            raise GoalError(f"{self.name} {otherwise}") from None

    async def _call(self, part: str, type: ServiceType, request: Mapping[str, Any]) -> dict[str, Any]:
        service = Interface(f"{self.name}/_action/{part}", type.name)
        try:
            answer = await self._graph.call(service, type.request.write(request), MAX_RESULT_BYTES)
            return type.response.read(answer, MAX_RESULT_BYTES)
        except (CallError, CdrError, DefinitionError) as error:
            raise GoalError(str(error)) from error

    def _stated_hashes(self, type: str) -> dict[str, str]:
        """Return the hashes of the parts of the action as its server states them."""
        parts = {f"{type}_SendGoal": "send_goal", f"{type}_GetResult": "get_result"}
        offers = self._graph.offers()
        return {part: hash_of(offers, "service", f"{self.name}/_action/{name}", part) for part, name in parts.items()}
