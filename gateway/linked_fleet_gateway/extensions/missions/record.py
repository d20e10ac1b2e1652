"""The record of a run of a mission, from which any gateway can go on with it. Pure values."""

from typing import Literal

from msgspec import Struct

from linked_fleet_gateway.extensions.missions.mission import Mission
from linked_fleet_gateway.faces import Claims

StepState = Literal["starting", "running", "waiting", "unknown", "succeeded", "failed", "cancelled", "skipped"]
ENDED: frozenset[StepState] = frozenset({"succeeded", "failed", "cancelled", "skipped"})
Phase = Literal["running", "paused", "blocked", "ending", "succeeded", "failed", "cancelled"]
OVER: frozenset[Phase] = frozenset({"succeeded", "failed", "cancelled"})


class StepRun(Struct, frozen=True, omit_defaults=True):
    """The state of a step that has no steps below it. Times in wall nanoseconds, 0 if there is none.

    A step that is ``starting`` may have been invoked or not; who goes on with the run invokes it with the same
    idempotency key. ``due_ns`` is when a wait ends. ``result`` is JSON.
    """

    state: StepState
    attempt: int = 1
    invocation: str = ""
    began_ns: int = 0
    ended_ns: int = 0
    due_ns: int = 0
    reason: str = ""
    result: str = ""


class Creator(Struct, frozen=True, omit_defaults=True):
    """The client that runs a mission: the name by which requests are counted, and the identity whose rights count."""

    client: str = ""
    identity: str = ""
    claims: Claims | None = None
    lease_token: str = ""


class Run(Struct, frozen=True, omit_defaults=True):
    """A run of a mission, under the id of its invocation.

    ``mission`` is the mission as it was when the run began. ``values`` are the parameters as JSON values. ``steps`` are
    by path (``mission.step_at``), ``rounds`` are the completed rounds of repeating steps. ``owner`` is the run of the
    gateway that carries it out, or empty. ``robots`` are those that its actions may move; ``token`` proves control of
    them, and ``controls`` are those whose lease is the run's own.
    """

    mission: Mission
    mission_path: str
    base: str
    values: dict[str, float | bool | str]
    creator: Creator
    began_ns: int
    robots: tuple[str, ...] = ()
    token: str = ""
    controls: tuple[str, ...] = ()
    owner: str = ""
    phase: Phase = "running"
    reason: str = ""
    outcome: Phase | Literal[""] = ""
    """The state in which it ends once its running steps have ended, while it is ``ending``."""
    ended_ns: int = 0
    steps: dict[str, StepRun] = {}
    rounds: dict[str, int] = {}
    notes: tuple[str, ...] = ()
