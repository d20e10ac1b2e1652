"""The tools that move and stop robots. Each sends requests to the gateway as any other client does."""

import asyncio
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

import anyio
from mcp_types import CallToolResult, ToolAnnotations
from pydantic import Field

from linked_fleet_gateway.api import Robot, await_turn, robot_of
from linked_fleet_gateway.extensions.mcp.message_context import MessageContext
from linked_fleet_gateway.extensions.mcp.tool import Progress, Target, Tool, content_result, refusal_result
from linked_fleet_gateway.faces import parts_of
from linked_fleet_gateway.serving import Reply, stop_segments
from linked_fleet_state.invocation import Invocation, InvocationState

_JSON = "application/json"
_PLAN = "plan"
"""Member of rehearsals and of bodies: a motion that is kept for a request of that very path."""
_PAUSE_S, _LOOK_S = 0.1, 1.0
_LEASE = "the Lock-Token of the control lease of the robot, if you have it"


class Rehearse(Tool):
    """Check an action without moving: shape, limits, lease, collisions. The result has the duration of the motion, or
    the reason for its refusal. If it has a plan, act with the plan added to the same body takes that very path."""

    action: Target = Field(description="IRI or path of an action, as returned by find")
    body: dict[str, Any] = Field(
        {}, description="the body of the action, valid against body_schema as returned by find"
    )
    lock_token: str = Field("", max_length=200, description=_LEASE)

    async def run(self, context: MessageContext, progress: Progress) -> CallToolResult:
        reply = await self._rehearsed(context)
        refusal = reply.status >= 400
        return content_result(reply, "It would be refused." if refusal else "It would be accepted. Nothing has moved.")

    async def _rehearsed(self, context: MessageContext) -> Reply:
        return await self._invoke(context, {"prefer": "dry-run"}, self.body)

    async def _invoke(self, context: MessageContext, fields: Mapping[str, str], body: Mapping[str, Any]) -> Reply:
        token = self.lock_token or context.request.headers.get("lock-token", "")
        own = {"content-type": _JSON, **({"lock-token": token} if token else {})}
        return await context.ask("POST", self.action, _JSON, {**fields, **own}, json.dumps(body).encode())


class Act(Rehearse):
    """Invoke an action and wait for its end. It is rehearsed first; if the path was planned, that very path is taken.
    Cancelling the request cancels the motion."""

    hints = ToolAnnotations(read_only_hint=False, destructive_hint=True, open_world_hint=True)
    rehearse: bool = Field(True, description="rehearse first, and move nothing if that is refused")
    wait_s: float = Field(60, ge=0, le=600, allow_inf_nan=False, description="seconds to wait for the end")
    idempotency_key: str = Field(
        "",
        pattern=r"^[\w.:~-]{0,200}$",
        description="an idempotency key: a repeated call with the same key moves nothing",
    )

    async def run(self, context: MessageContext, progress: Progress) -> CallToolResult:
        body: Mapping[str, Any] = self.body
        if self.rehearse:
            rehearsed = await self._rehearsed(context)
            if rehearsed.status >= 400:
                return refusal_result(rehearsed.problem, "The rehearsal was refused. Nothing has moved.")
            body = self._on_the_path_of(rehearsed)
        fields = {"prefer": "respond-async, return=representation"}
        if self.idempotency_key:
            fields["idempotency-key"] = f'"{self.idempotency_key}"'
        with anyio.CancelScope(shield=True):  # a client that cancels now must learn what has begun
            reply = await self._invoke(context, fields, body)
        iri = reply.headers.get("location", "")
        if reply.status >= 400 or not iri:
            return content_result(reply, f"Its state is at {iri}." if iri else "")
        try:
            await _follow(context, iri, self.wait_s, progress)
        except asyncio.CancelledError:
            if not context.ending.is_set():  # a gateway that ends leaves motions to the others
                with anyio.CancelScope(shield=True):
                    await context.ask("POST", iri + "/actions/cancel", _JSON)
            raise
        return _ended(iri, await context.ask("GET", iri, _JSON))

    def _on_the_path_of(self, rehearsed: Reply) -> Mapping[str, Any]:
        """Return the body with the plan that the rehearsal offers, if its path was planned.

        With an idempotency key it stays as it is, because a repeated call has to send the same request.
        """
        said = json.loads(rehearsed.content) if rehearsed.content and "json" in rehearsed.media_type else {}
        planned = _PLAN in said and "plannedBecause" in said and not self.idempotency_key
        return {_PLAN: said[_PLAN], **self.body} if planned else self.body


class Stop(Tool):
    """Stop a joint, a robot or all robots, or cancel an invocation, at once. It takes neither lease nor rehearsal."""

    hints = ToolAnnotations(read_only_hint=False, destructive_hint=False, idempotent_hint=True, open_world_hint=True)
    target: Target = Field(
        "/",
        description="IRI or path of a robot, joint or invocation; / is all robots. A component stops with its robot",
    )

    async def run(self, context: MessageContext, progress: Progress) -> CallToolResult:
        with anyio.CancelScope(shield=True):
            for path in _stops("/" + context.path_of(self.target).strip("/"), context.view.robots):
                reply = await context.ask("POST", path, _JSON, {"prefer": "return=representation"})
                if reply.status != 404:
                    break
            else:
                await await_turn(context.request)  # it stops nothing
        return content_result(reply, "" if reply.status >= 400 else f"Done: {path}")


def _stops(path: str, robots: Mapping[str, Robot]) -> Iterator[str]:
    """Yield candidate paths of the stop action for ``path``: the first that exists is the right one.

    An action of a component stops nothing, whatever its name.
    """
    segments = path[1:].split("/")
    in_component = _is_in_component(segments, robots)
    if not in_component and segments[-1] in stop_segments():
        yield path
    elif path == "/":
        yield "/actions/stopAll"
    else:
        if "invocations" in segments:
            yield f"{path}/actions/cancel"
        if len(segments) > 1 and not in_component:
            yield f"/{segments[0]}/{segments[1]}/actions/hold"
        yield f"/{segments[0]}/actions/stop"


def _is_in_component(segments: Sequence[str], robots: Mapping[str, Robot]) -> bool:
    robot = robots.get(robot_of("/" + "/".join(segments)) or "")
    return robot is not None and segments[1:2] != [] and segments[1] in parts_of(robot)


async def _follow(context: MessageContext, iri: str, wait_s: float, progress: Progress) -> None:
    """Report the progress of an invocation until it has ended or ``wait_s`` have passed."""
    invocation = context.view.invocations.get(iri.rpartition("/")[2])
    last = -1.0
    with suppress(TimeoutError):
        async with asyncio.timeout(wait_s):
            while invocation is not None:
                if invocation.progress > last:  # each notification must increase it
                    last = invocation.progress
                    await progress(last, 1.0, invocation.state.value)
                if invocation.state.terminal:
                    return
                before = invocation.state, invocation.progress
                await context.core.wait_until(invocation, partial(_differs, before), _LOOK_S)
                await asyncio.sleep(_PAUSE_S)  # many changes may share one notification


def _differs(before: tuple[InvocationState, float], one: Invocation) -> bool:
    return (one.state, one.progress) != before


def _ended(iri: str, reply: Reply) -> CallToolResult:
    """Return the invocation as it is now; an error if it did not succeed."""
    if reply.status >= 400:
        return content_result(reply)
    found = {"iri": iri, **json.loads(reply.content)}
    state = InvocationState(found["state"].rpartition("#")[2])
    reason = f": {found['reason']}" if found.get("reason") else ""
    result = content_result(
        reply,
        f"The motion has ended: {state}{reason}." if state.terminal else f"It has not ended ({state}); see {iri}.",
    )
    result.structured_content, result.is_error = found, state.terminal and state is not InvocationState.SUCCEEDED
    return result
