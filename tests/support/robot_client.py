"""A robot as a client of its fleet uses it, on a machine that may be busy: nothing is read once that can be late."""

from contextlib import suppress
from typing import Any, NamedTuple

import httpx
import pytest

from connections import http_client
from linked_fleet_client.action import Action
from linked_fleet_client.errors import ClientError, Problem
from linked_fleet_client.fleet import Fleet, Thing
from linked_fleet_client.invocation import Invocation
from running import eventually

_CONFLICT = 409
_UNAVAILABLE = 503


class Ended(NamedTuple):
    """How an invocation ended, as JSON."""

    state: str
    reason: str
    said: dict[str, Any]


def joint_angle(robot: Thing | Fleet, path: str) -> float | None:
    """Return the angle of a joint, None while it is not known."""
    with suppress(ClientError, httpx.HTTPError):
        found: float | None = robot.at(path).properties["rotation"].value.number
        return found
    return None


def await_angle(robot: Thing | Fleet, path: str, angle: float, within: float = 1e-3) -> None:
    """Wait until the joint is measured there."""

    def there() -> bool:
        return joint_angle(robot, path) == pytest.approx(angle, abs=within)

    eventually(there, lambda: f"{path} at {angle} rad, it is at {joint_angle(robot, path)}")


def begin(action: Action, **given: Any) -> Invocation:
    """Invoke an action as soon as its robot takes it.

    A joint that something else moves, or whose state is late, is refused (409); so is a robot that is not there (503).
    """
    refused = [""]

    def attempt() -> Invocation | None:
        try:
            return action(**given)
        except Problem as problem:
            if problem.status not in (_CONFLICT, _UNAVAILABLE):
                raise
            refused.append(str(problem))
            return None

    return eventually(attempt, lambda: f"{action.name} is taken: {refused[-1]}")


def state_of(run: Invocation) -> dict[str, Any]:
    """Return the invocation as JSON."""
    with http_client() as http:
        said: dict[str, Any] = http.get(run.iri, headers={"accept": "application/json"}).json()
    return said


def end_of(run: Invocation, timeout_s: float = 60.0) -> Ended:
    """Wait until the invocation has ended."""
    word, said = run.wait(timeout_s), state_of(run)
    return Ended(str(word), said.get("reason", ""), said)
