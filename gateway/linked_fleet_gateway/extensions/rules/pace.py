"""The pace and the queue in which the condition of a rule is evaluated.

Rules of a client that cost much must not keep those of others from being evaluated, which may stop robots. Conditions
that are known to be quick have a queue of their own; in both queues clients take turns. A condition that exceeds the
limits of a query is evaluated ever less often, and disabled if it never succeeds.
"""

import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass

from linked_fleet_gateway.extensions.query.turns import FairTurns

QUICK_S = 1.0
"""Duration of an evaluation up to which a condition is quick."""
FIRST_PAUSE_S, LONGEST_PAUSE_S = 1.0, 60.0
MOST_FAILURES = 6
"""Evaluations in a row that exceed the limits, after which a rule is disabled."""
_MOST_WAITING = 10_000  # evaluations: no limit, because the number of rules has one


@dataclass
class Pace:
    """The pace of one rule.

    ``failures`` counts the evaluations in a row that were too costly, ``spent_s`` is the duration of the last one,
    without the time for which it waited.
    """

    failures: int = 0
    is_quick: bool = False
    spent_s: float = 0.0

    @property
    def pause_s(self) -> float:
        """The pause before the next evaluation, in seconds; 0 after a success."""
        return min(FIRST_PAUSE_S * 2 ** (self.failures - 1), LONGEST_PAUSE_S) if self.failures else 0.0

    @property
    def is_hopeless(self) -> bool:
        return self.failures >= MOST_FAILURES

    @contextmanager
    def timed(self) -> Iterator[None]:
        """Record the duration of a query, and its success if it raises nothing."""
        begun_s = time.monotonic()
        try:
            yield
            self.failures, self.is_quick = 0, time.monotonic() - begun_s <= QUICK_S
        finally:
            self.spent_s += time.monotonic() - begun_s

    def fail(self) -> None:
        self.failures, self.is_quick = self.failures + 1, False


class Queues:
    """The evaluations that wait: one at once of quick conditions, and one of others."""

    def __init__(self) -> None:
        self._quick, self._others = (FairTurns(1, _MOST_WAITING, _MOST_WAITING) for _ in range(2))

    @asynccontextmanager
    async def turn(self, client: str, pace: Pace) -> AsyncIterator[None]:
        async with (self._quick if pace.is_quick else self._others).turn(client):
            yield


def too_costly(detail: str) -> str:
    """Return the reason why a rule is disabled; ``detail`` is that of its last evaluation."""
    return (
        f"disabled because its condition was too costly {MOST_FAILURES} times in a row: {detail} "
        "Simplify the condition, then enable the rule."
    )
