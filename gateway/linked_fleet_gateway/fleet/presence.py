"""Liveliness tokens of agents, by robot and run, in bounded memory. Pure.

A peer can invent robots by declaring tokens, so the table bounds the runs of one robot and the number of robots without
a description. Tokens beyond the bounds are not kept, and ``incomplete`` is set.
"""

MAX_RUNS = 8
"""Most runs of one robot at once. The highest are kept, because the highest is the present one."""
MAX_UNDESCRIBED = 10_000
"""Most robots without a description: as many as a fleet that joins at one moment."""

Token = tuple[str, int]
"""Robot and run."""


class Presence:
    """The present tokens. Not thread-safe."""

    def __init__(self) -> None:
        self._runs: dict[str, set[int]] = {}
        self._undescribed: dict[str, None] = {}
        self.incomplete = False
        """True if a present token was refused or forgotten. The owner then lists all tokens to find it."""

    def __contains__(self, token: Token) -> bool:
        return token[1] in self._runs.get(token[0], ())

    @property
    def tokens(self) -> set[Token]:
        return {(robot, run) for robot, runs in self._runs.items() for run in runs}

    @property
    def undescribed(self) -> int:
        """The number of robots without a description."""
        return len(self._undescribed)

    @property
    def full(self) -> bool:
        """True if there is no room for another robot without a description."""
        return len(self._undescribed) >= MAX_UNDESCRIBED

    def runs(self, robot: str) -> frozenset[int]:
        return frozenset(self._runs.get(robot, ()))

    def add(self, token: Token, described: bool = False) -> Token | None:
        """Add a token. Return the one removed for it: the lowest run of that robot, or ``token`` itself.

        ``described`` says that the robot has described itself before. Raises OverflowError if there is no room for the
        robot.
        """
        robot, run = token
        runs = self._runs.get(robot)
        if runs is None:
            if not described and self.full:
                self.incomplete = True
                raise OverflowError(f"more than {MAX_UNDESCRIBED} robots have a token and no description")
            self._runs[robot] = {run}
            if not described:
                self._undescribed[robot] = None
            return None
        runs.add(run)
        if len(runs) <= MAX_RUNS:
            return None
        self.incomplete = True
        lowest = min(runs)
        runs.remove(lowest)
        return robot, lowest

    def remove(self, token: Token) -> None:
        robot, run = token
        runs = self._runs.get(robot, set())
        runs.discard(run)
        if not runs:
            self._runs.pop(robot, None)
            self._undescribed.pop(robot, None)

    def describe(self, robot: str) -> None:
        """Record that the robot has described itself."""
        self._undescribed.pop(robot, None)

    def forget(self, robot: str) -> frozenset[int]:
        """Drop the tokens of a robot although they are present. Return their runs."""
        self.incomplete = True
        self._undescribed.pop(robot, None)
        return frozenset(self._runs.pop(robot, ()))
