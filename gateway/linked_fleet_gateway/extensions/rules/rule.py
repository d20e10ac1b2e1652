"""Rules and their firings; pure values."""

from dataclasses import dataclass, field
from enum import StrEnum

from linked_fleet_gateway.api import robot_of
from linked_fleet_gateway.faces import Claims, View


@dataclass(frozen=True)
class Rule:
    """A rule as written by its creator.

    ``invokes`` is the path of an action, or ``?`` and the variable that names it. ``body`` is N-Triples about
    ``_:body``, in which a node with ``lf:variable`` stands for the value of the variable; empty for an action without
    input.
    """

    id: str
    """A UUID."""
    title: str
    condition: str
    """A SPARQL SELECT."""
    invokes: str
    base: str
    """Public URL under which it was written, without trailing slash; base of IRIs in its condition."""
    client: str
    """Name or network of its creator, by which rules and motions are counted."""
    created_ns: int
    body: str = ""
    told_apart_by: tuple[str, ...] = ()
    """Variables that identify rows; empty for all variables of the condition."""
    interval_s: float = 1.0
    """Least time between two firings in seconds; rows that start to hold earlier are suppressed."""
    holds_for_s: float = 0.0
    """Time that a row must hold before it fires, in seconds."""
    enabled: bool = True
    reason: str = ""
    """The reason if somebody else than its creator disabled it."""
    creator: str = ""
    """Name of the identity whose rights it has; empty if authentication was off."""
    claims: Claims | None = None
    """The claims of a creator authenticated by an issuer."""
    sees: tuple[str, ...] = ("*",)
    """Patterns of the robots that its creator could read."""

    @property
    def view(self) -> View:
        return View.of(frozenset(self.sees), self.creator)

    @property
    def variable(self) -> str | None:
        """The variable that names the action."""
        return self.invokes[1:] if self.invokes.startswith("?") else None

    @property
    def robot(self) -> str | None:
        """The only robot that it can act on; None for several, or the fleet."""
        return None if self.variable else robot_of(self.invokes)


class FiringState(StrEnum):
    """States. RUNNING: claimed, its action is being invoked. UNKNOWN: its gateway ended meanwhile."""

    RUNNING = "running"
    ACCEPTED = "accepted"
    FAILED = "failed"
    SUPPRESSED = "suppressed"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class Firing:
    """One firing. ``bindings`` are N-Triples terms by variable; ``invocation`` is the path of the invocation.

    ``causes`` are the ids of rules that caused it; ``self_caused`` the times of the last minute at which the rule
    itself was among them; ``revision`` is that of the rule.
    """

    at_ns: int
    bindings: dict[str, str]
    state: FiringState = FiringState.RUNNING
    invocation: str = ""
    reason: str = ""
    causes: tuple[str, ...] = ()
    self_caused: tuple[int, ...] = ()
    revision: int = 0


@dataclass
class RuleRecord:
    """A rule with its latest firings by number. ``fault`` is the reason why it cannot be evaluated."""

    rule: Rule
    revision: int
    firings: dict[int, Firing] = field(default_factory=dict)
    suppressed: int = 0
    fault: str = ""
    begun: bool = False
    """True if it was evaluated since it was written."""
    suspended: str = ""
    """The reason why its creator may no longer have it."""
