"""One invocation of an action, and the control lease of a robot. Wall nanoseconds."""

import re
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Literal

from linked_fleet_agent.wire.messages import StreamCounts
from linked_fleet_state.unchecked import UncheckedLink

Priority = Literal["program", "person"]
"""The priority of a control lease: a person may take it from a program."""


@dataclass(frozen=True)
class Lease:
    """The control lease of one robot, without the secret that proves it.

    ``left_s`` is the remaining time when Redis was asked, independent of the gateway's clock.
    """

    id: str
    robot: str
    holder: str
    taken_ns: int
    expires_ns: int
    duration_s: float
    left_s: float = field(default=0.0, compare=False)
    priority: Priority = "program"


FLEET = ""  # stands for the robot of an invocation of the whole fleet

_WORD = re.compile(r"[a-z]*")


class InvocationState(StrEnum):
    """States. UNKNOWN: the agent did not answer or has gone; progress or the deadline will resolve it."""

    ACCEPTED = "accepted"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELLED = "cancelled"
    PREEMPTED = "preempted"
    UNKNOWN = "unknown"

    @property
    def terminal(self) -> bool:
        return self in TERMINAL


# From best to worst: the outcome of a fleet invocation is the worst of its robots.
TERMINAL = (
    InvocationState.SUCCEEDED,
    InvocationState.CANCELLED,
    InvocationState.PREEMPTED,
    InvocationState.FAILED,
)
NOT_BEGUN = "not-begun"
"""Refusal code of a command that never reached its agent, which will not begin it any more."""
ENDS = {**{state.value: state for state in TERMINAL}, "refused": InvocationState.FAILED}


@dataclass
class Invocation:
    """One invocation of the action at ``action``, a path such as ``/baxter/right_s1/actions/rotate``.

    ``targets`` are the commanded and ``result`` the last measured positions by joint, in rad or m. ``client`` is the
    displayed name of the caller, ``body`` the accepted body as N-Triples, ``lease`` the id of the lease whose end
    cancels the invocation. ``duration_s`` is the agent's estimate. ``progress`` is the completed share, 0 to 1; for
    invocations of the fleet it is the share of robots that have ended. ``facts`` are further numbers with the unit in
    their names (``residual_m``). ``preempts`` are the ids of the invocations that it ended, ``preempted_by`` is the one
    that ended it. ``stops`` are the joints that it stops, empty for all; None for a motion. ``incarnation`` is the run
    of the agent, 0 for several. ``refused`` is the agent's refusal code, or ``NOT_BEGUN``. ``expired`` means that it
    failed because no end was reported in time; a later report of the robot overrides this. ``unchecked`` are the links
    that the check of the motion did not cover, each after its path. ``operation`` is True for an action that is no
    motion: a gateway carries it out, with ``output`` (N-Triples about ``_:output``) as its result, until it ends or
    somebody asks to cancel it, for the reason ``cancelling``. ``moves`` is what an action of a component moves, joints
    or ``base``; one that ``resumes`` goes on when its agent ends, and the next run of the agent tells of it;
    ``feedback`` is the last one that it gave and ``outcome`` its result, both in JSON. ``limited`` says why it is
    slower than asked for. ``stream`` counts the samples of one that was opened as a stream. ``about`` are robots that
    an invocation of the fleet tells of: it is shown to its client, and to those who may see all of them.

    ``robots`` has the answer of each robot to an invocation of the fleet: a word, which is a state or ``refused``,
    optionally followed by details, as in ``failed: the joint is blocked``. Any other word means that the robot has not
    ended.
    """

    id: str
    robot: str
    action: str
    targets: dict[str, float]
    created_ns: int
    deadline_ns: int
    client: str = ""
    body: str = ""
    duration_s: float | None = None
    started_ns: int | None = None
    ended_ns: int | None = None
    state: InvocationState = InvocationState.ACCEPTED
    reason: str = ""
    progress: float = 0.0
    result: dict[str, float] = field(default_factory=dict)
    preempts: tuple[str, ...] = ()
    preempted_by: str = ""
    lease: str = ""
    facts: dict[str, float] = field(default_factory=dict)
    robots: dict[str, str] = field(default_factory=dict)
    stops: tuple[str, ...] | None = None
    incarnation: int = 0
    refused: str = ""
    expired: bool = False
    unchecked: tuple[tuple[str, UncheckedLink], ...] = ()
    operation: bool = False
    output: str = ""
    cancelling: str = ""
    moves: tuple[str, ...] = ()
    resumes: bool = False
    feedback: str = ""
    outcome: str = ""
    limited: str = ""
    detour: str = ""
    stream: StreamCounts | None = None
    about: tuple[str, ...] = ()

    @property
    def is_motion(self) -> bool:
        """True if it moves a robot."""
        return self.stops is None and not self.operation and bool(self.targets or self.moves)

    @property
    def is_final(self) -> bool:
        """True if it has ended and no report can change that."""
        return self.state.terminal and not self.expired

    @property
    def accepted(self) -> bool:
        """True if the agent is known to have accepted it, whatever happened later."""
        return self.duration_s is not None or self.started_ns is not None


def merge_copies(held: Invocation, found: Invocation) -> Invocation:
    """Merge two copies of one invocation. If both have a reported end, that of ``found`` wins.

    Neither copy need be later: the gateway that receives progress may not know yet what the agent answered to another
    gateway.
    """
    base, other = (found, held) if _newer(held, found) else (held, found)
    whole = replace(
        base,
        duration_s=other.duration_s if base.duration_s is None else base.duration_s,
        started_ns=base.started_ns or other.started_ns,
        preempts=base.preempts or other.preempts,
        feedback=base.feedback or other.feedback,
        stream=base.stream or other.stream,
        deadline_ns=max(base.deadline_ns, other.deadline_ns),
        cancelling=base.cancelling or other.cancelling,
    )
    if whole.robots and not whole.state.terminal:
        whole.robots = {**other.robots, **base.robots}
        for robot, answer in other.robots.items():
            if _weight(answer) > _weight(whole.robots[robot]):
                whole.robots[robot] = answer
        update_fleet_state(whole)
    return whole


def _newer(held: Invocation, found: Invocation) -> bool:
    """Return True if ``found`` takes precedence: reported ends before expiry, and of two expiries the one with the
    later deadline.
    """
    if held.is_final or found.is_final:
        return found.is_final
    if held.expired or found.expired:
        return (found.deadline_ns, found.expired) > (held.deadline_ns, held.expired)
    if held.operation:  # only the gateway that carries it out moves the deadline
        return found.deadline_ns > held.deadline_ns
    return held.state is InvocationState.ACCEPTED and found.state is not InvocationState.ACCEPTED


def update_fleet_state(invocation: Invocation) -> None:
    """Update the state of a fleet invocation from the answers of its robots."""
    words = [reported_state(answer) for answer in invocation.robots.values()]
    ended = [ENDS[each] for each in words if each in ENDS]
    invocation.progress = len(ended) / len(words)
    if len(ended) == len(words):
        worst = max(ended, key=TERMINAL.index)
        invocation.state = worst
        all_well = worst is InvocationState.SUCCEEDED
        invocation.reason = "" if all_well else f"{ended.count(worst)} of {len(ended)} robots: {worst}"
    elif words.count(InvocationState.UNKNOWN) == len(words) - len(ended):
        invocation.state = InvocationState.UNKNOWN


def reported_state(answer: str) -> str:
    """Return the state at the start of a robot's answer."""
    found = _WORD.match(answer)
    return found[0] if found else ""


def has_ended(answer: str) -> bool:
    return reported_state(answer) in ENDS


def _weight(answer: str) -> int:
    """Return the precedence of an answer: ends first, then anything but a mere acceptance."""
    return 2 if has_ended(answer) else int(reported_state(answer) != InvocationState.ACCEPTED)
