"""Keys that many clients use at the same time, each for a limited number of operations, so that it can be checked."""

import random
from collections.abc import Callable

from histories.history import History

_MOST_OPEN = 8
"""Limit of operations on one key without a response: each doubles the checker's work."""


class Keys:
    """``count`` keys at a time, each replaced after about ``uses``, or after too many operations without a response."""

    def __init__(self, history: History, make: Callable[[], str], count: int, uses: int) -> None:
        self._history, self._make, self._uses = history, make, uses
        self.all: list[str] = []
        self._open = [self._new() for _ in range(count)]
        self._left = dict.fromkeys(self._open, uses)

    def _new(self) -> str:
        self.all.append(self._make())
        return self.all[-1]

    def pick(self, draws: random.Random) -> str:
        key = draws.choice(self._open)
        self._left[key] -= 1
        if not self._left[key] or self._history.open[key] >= _MOST_OPEN:
            self._open[self._open.index(key)] = new = self._new()
            self._left[new] = self._uses
        return key
