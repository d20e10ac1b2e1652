"""The occasion of a recording: the end of an invocation, or whatever another extension has seen."""

from collections.abc import Mapping
from dataclasses import dataclass

from linked_fleet_state.invocation import Invocation, InvocationState


@dataclass(frozen=True)
class Occasion:
    """An occasion to record a robot. ``id`` is a UUID, the same at all gateways; ``says`` is what happened.

    ``is_error``: it is more than a warning. ``name`` and ``about`` are a metadata record of the file. ``at_ns`` is a
    wall time, the same at all gateways.
    """

    id: str
    at_ns: int
    says: str
    is_error: bool
    name: str
    about: Mapping[str, str]


def outcome(invocation: Invocation) -> Occasion:
    """Return the occasion of an invocation that has failed or is stopped."""
    one = invocation
    says = f"{one.action}: {one.state}" + (f", {one.reason}" if one.reason else "")
    about = {"id": str(one.id), "action": one.action, "client": one.client, "state": one.state, "reason": one.reason}
    about = {name: str(value) for name, value in about.items() if value}
    return Occasion(str(one.id), one.created_ns, says, one.state is InvocationState.FAILED, "invocation", about)
