"""Liveliness tokens of agents, by robot and run, in bounded memory. Pure.

A token is all that a peer needs to make up a robot, so the table has a bound for the runs of one robot and one for the
robots that have not described themselves. Tokens beyond them are not kept; ``incomplete`` says that there are some.
"""

MAX_RUNS = 8
"""Runs of one robot at once. The highest are kept: the highest is the present one."""
MAX_UNDESCRIBED = 10_000
"""Robots without a description at once: as many as a fleet that joins at one moment."""

Token = tuple[str, int]
"""Robot and run."""


class Presence:
    """Tokens that are present. Not thread-safe."""

    def __init__(self) -> None:
        self._runs: dict[str, set[int]] = {}
        self._undescribed: dict[str, None] = {}
        self.incomplete = False
        """Some token is present that this table has refused or forgotten. The owner lists all tokens to find it."""

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
        """No further robot without a description has room."""
        return len(self._undescribed) >= MAX_UNDESCRIBED

    def runs(self, robot: str) -> frozenset[int]:
        return frozenset(self._runs.get(robot, ()))

    def add(self, token: Token, described: bool = False) -> Token | None:
        """Keep a token. Return the one that made room for it: the lowest run of that robot, or ``token`` itself.

        ``described``: the robot has described itself before. Raises OverflowError for a robot that has no room.
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
        """The robot has described itself."""
        self._undescribed.pop(robot, None)

    def forget(self, robot: str) -> frozenset[int]:
        """Drop the tokens of a robot although they are present. Return their runs."""
        self.incomplete = True
        self._undescribed.pop(robot, None)
        return frozenset(self._runs.pop(robot, ()))
