"""One invocation of an action: what is known of it, and what two copies of it know together."""

import re
from dataclasses import dataclass, field, replace
from enum import StrEnum

FLEET = ""  # what stands for the robot of an invocation that is the whole fleet's

_WORD = re.compile(r"[a-z]*")


class InvocationState(StrEnum):
    """UNKNOWN: nobody answered the command, or the agent is gone; progress or the deadline will tell."""

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


# From the best to the worst: what a fleet's invocation comes to is the worst of what its robots came to.
TERMINAL = (
    InvocationState.SUCCEEDED,
    InvocationState.CANCELLED,
    InvocationState.PREEMPTED,
    InvocationState.FAILED,
)
ENDS = {**{state.value: state for state in TERMINAL}, "refused": InvocationState.FAILED}


@dataclass
class Invocation:
    """One invocation of the action at ``action``, a path such as ``/baxter/right_s1/actions/rotate``.

    ``targets`` are the commanded and ``result`` the last measured positions by joint, in rad or m. ``client`` is who
    asked, as it is shown, ``body`` what was admitted, as N-Triples, ``lease`` the id of the lease that it ends with.
    ``duration_s`` is what the agent expects, ``progress`` the share that is done, 0 to 1; of the fleet's invocations
    the share of robots that have ended. ``facts`` are further numbers with the unit in their names (``residual_m``).
    ``preempts`` are the ids that it ended, ``preempted_by`` is the one that ended it. ``stops`` are the joints that it
    stops, all for none named; None for a motion. ``incarnation`` is the run of the agent that was asked, 0 for several.
    ``refused`` is the code with which the agent refused it. ``expired``: it failed because nobody has reported its end
    in time, which is a guess; whatever the robot says of it afterwards is true.

    ``robots`` says of the fleet's invocations what each robot answered: a word, which is a state or ``refused``, and
    perhaps what a human should know, as in ``failed: the joint is blocked``. Any other word is an open end.
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

    @property
    def over(self) -> bool:
        """True if it has ended for good."""
        return self.state.terminal and not self.expired

    @property
    def accepted(self) -> bool:
        """True if the agent is known to have accepted it, whatever became of it."""
        return self.duration_s is not None or self.started_ns is not None


def merged(held: Invocation, found: Invocation) -> Invocation:
    """Merge two copies of one invocation; of two ends that were reported ``found`` is the one that counts.

    Neither need be the later one: who heard the robot may not know yet what its agent answered to whom asked it.
    """
    base, other = (found, held) if _newer(held, found) else (held, found)
    whole = replace(
        base,
        duration_s=other.duration_s if base.duration_s is None else base.duration_s,
        started_ns=base.started_ns or other.started_ns,
        preempts=base.preempts or other.preempts,
        deadline_ns=max(base.deadline_ns, other.deadline_ns),
    )
    if whole.robots and not whole.state.terminal:
        whole.robots = {**other.robots, **base.robots}
        for robot, answer in other.robots.items():
            if _weight(answer) > _weight(whole.robots[robot]):
                whole.robots[robot] = answer
        gather(whole)
    return whole


def _newer(held: Invocation, found: Invocation) -> bool:
    """Return True if ``found`` says what became of it: an end over a guess, and the guess of who allowed more time."""
    if held.over or found.over:
        return found.over
    if held.expired or found.expired:
        return (found.deadline_ns, found.expired) > (held.deadline_ns, held.expired)
    return held.state is InvocationState.ACCEPTED and found.state is not InvocationState.ACCEPTED


def gather(invocation: Invocation) -> None:
    """Derive the state of the fleet's invocation from the answers of its robots."""
    words = [word(answer) for answer in invocation.robots.values()]
    ended = [ENDS[each] for each in words if each in ENDS]
    invocation.progress = len(ended) / len(words)
    if len(ended) == len(words):
        worst = max(ended, key=TERMINAL.index)
        invocation.state = worst
        all_well = worst is InvocationState.SUCCEEDED
        invocation.reason = "" if all_well else f"{ended.count(worst)} of {len(ended)} robots: {worst}"
    elif words.count(InvocationState.UNKNOWN) == len(words) - len(ended):
        invocation.state = InvocationState.UNKNOWN


def word(answer: str) -> str:
    """The state that the answer of one robot begins with."""
    found = _WORD.match(answer)
    return found[0] if found else ""


def has_ended(answer: str) -> bool:
    return word(answer) in ENDS


def _weight(answer: str) -> int:
    """An end outweighs everything, and anything that the robot is merely waited for."""
    return 2 if has_ended(answer) else int(word(answer) != InvocationState.ACCEPTED)
