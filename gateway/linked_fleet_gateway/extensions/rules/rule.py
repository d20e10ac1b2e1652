"""Rules and their firings, one each time that the pattern started to hold; pure values."""

from dataclasses import dataclass, field
from enum import StrEnum

from linked_fleet_gateway.identity.rights import ALL, EVERY, Claims, View, view
from linked_fleet_gateway.resources.paths import robot_of


@dataclass(frozen=True)
class Rule:
    """A rule as its creator wrote it. ``invokes`` is the path of an action, or ``?`` and the variable that names it;
    ``body`` is N-Triples about ``_:body`` in which a node with ``lf:variable`` stands for what the variable is bound
    to, empty for an action that takes none."""

    id: str
    """A UUID."""
    title: str
    condition: str
    """A SPARQL SELECT."""
    invokes: str
    base: str
    """Public URL under which it was written, without slash; what the condition sees is named under it."""
    client: str
    """Name or network address of its creator; its rules and motions are counted."""
    created_ns: int
    body: str = ""
    told_apart_by: tuple[str, ...] = ()
    """Variables by which rows are told apart; all of the condition's for none."""
    interval_s: float = 1.0
    """The least time between two firings; what starts to hold before is suppressed."""
    enabled: bool = True
    reason: str = ""
    """Why it is not enabled, where it was not its creator who disabled it."""
    creator: str = ""
    """Name of the identity whose rights it has; empty where none were configured."""
    claims: Claims | None = None
    """The claims of a creator who came with the token of an issuer."""
    sees: tuple[str, ...] = (EVERY,)
    """Patterns of the robots that its creator could read."""

    @property
    def view(self) -> View:
        return ALL if EVERY in self.sees else view(frozenset(self.sees), self.creator)

    @property
    def variable(self) -> str | None:
        """The variable that names the action."""
        return self.invokes[1:] if self.invokes.startswith("?") else None

    @property
    def robot(self) -> str | None:
        """The one robot that it can act on; None for any, or the fleet."""
        return None if self.variable else robot_of(self.invokes)


class FiringState(StrEnum):
    """RUNNING: claimed, and its action is being invoked. UNKNOWN: its gateway ended meanwhile."""

    RUNNING = "running"
    ACCEPTED = "accepted"
    FAILED = "failed"
    SUPPRESSED = "suppressed"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class Firing:
    """``bindings``: terms as N-Triples, by variable; ``invocation``: the path of what was invoked.

    ``causes``: ids of rules without whose earlier firings it would not have been; ``self_caused``: the times of the
    last minute at which the rule itself was among them; ``revision``: of the rule.
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
class Known:
    """A rule as it is known here, with its latest firings by number. ``fault``: why it cannot be evaluated."""

    rule: Rule
    revision: int
    firings: dict[int, Firing] = field(default_factory=dict)
    suppressed: int = 0
    fault: str = ""
    begun: bool = False
    """True if it was evaluated since it was written."""
    suspended: str = ""
    """Why its creator may not have it any more."""
