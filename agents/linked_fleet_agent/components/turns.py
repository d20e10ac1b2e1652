"""Motions and moving actions that wait until what moved the same before them has come to rest. Pure."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from linked_fleet_agent.motion import Outcome, State


@dataclass(frozen=True)
class Turn:
    """Something that begins when what it ``moves`` is free. ``begin`` returns its first outcomes."""

    id: str
    moves: frozenset[str]
    is_free: Callable[[], bool]
    begin: Callable[[], Iterable[Outcome]]
    until_s: float

    def outcome(self, state: State, reason: str = "", successor: str = "") -> Outcome:
        return Outcome(self.id, state, (), reason[:1024], 0.0, successor)


class Turns:
    """The waiting turns in their order. Times are monotonic seconds and are passed in."""

    def __init__(self) -> None:
        self._waiting: dict[str, Turn] = {}

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def add(self, turn: Turn) -> Outcome:
        """Let something wait. Return its first outcome."""
        self._waiting[turn.id] = turn
        return turn.outcome("running")

    def waiting(self, moves: Iterable[str] | None = None) -> list[str]:
        """Return the ids of what waits to move one of these; of all for None."""
        wanted = None if moves is None else frozenset(moves)
        return [each.id for each in self._waiting.values() if wanted is None or each.moves & wanted]

    def end(self, ids: Iterable[str], state: State, reason: str, successor: str = "") -> list[Outcome]:
        """End what waits and will not begin any more."""
        ended = [self._waiting.pop(each) for each in ids if each in self._waiting]
        return [each.outcome(state, reason, successor) for each in ended]

    def step(self, now_s: float, why: Callable[[], str]) -> list[Outcome]:
        """Begin what can begin. What has waited too long fails with the reason that ``why`` returns."""
        outcomes = list[Outcome]()
        for turn in list(self._waiting.values()):
            if turn.is_free():
                del self._waiting[turn.id]
                outcomes += turn.begin()
            elif now_s > turn.until_s:
                reason = why() or "what moved the same before it did not come to rest"
                outcomes += self.end([turn.id], "failed", reason)
        return outcomes
