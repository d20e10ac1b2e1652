"""Limits of connections, and the choice of the one that gives way to a new one.

A connection without a running request can be closed without harm. So if all places are taken, the one that has been
idle for longest is closed, unless its client still reads the last response. A new connection is refused only if none
can be closed, or if all places of its address are busy.
"""

import resource
from collections import Counter
from collections.abc import Callable

_SPARE_FILES = 256  # for Zenoh, Redis, receivers of callbacks and the log


class Sockets:
    """The connections of a server: ``most`` in total, ``most_of_one`` per client; each is any hashable object."""

    def __init__(self, most: int, most_of_one: int) -> None:
        self._most, self._most_of_one = most, most_of_one
        self._client: dict[object, str] = {}
        self._of: Counter[str] = Counter()
        self._idle: dict[object, Callable[[], bool]] = {}

    def __len__(self) -> int:
        return len(self._client)

    def open(self, connection: object, client: str) -> bool:
        """Register a connection, closing an idle one if necessary. Return False if there is no place."""
        full = len(self._client) >= self._most or self._of[client] >= self._most_of_one
        if full and not self._make_room(client):
            return False
        self._client[connection] = client
        self._of[client] += 1
        return True

    def idle(self, connection: object, give_way: Callable[[], bool]) -> None:
        """Mark a connection as idle; ``give_way`` may be called to close it."""
        if connection in self._client:
            self._idle.setdefault(connection, give_way)

    def busy(self, connection: object) -> None:
        self._idle.pop(connection, None)

    def close(self, connection: object) -> None:
        """Remove a closed connection; may be repeated."""
        self._idle.pop(connection, None)
        client = self._client.pop(connection, None)
        if client is not None:
            self._of[client] -= 1
            if not self._of[client]:
                del self._of[client]

    def _make_room(self, client: str) -> bool:
        crowded = self._of[client] >= self._most_of_one
        for connection, give_way in self._idle.items():
            if (not crowded or self._client[connection] == client) and give_way():
                self.close(connection)
                return True
        if not self._of[client]:
            del self._of[client]
        return False


def within_files(most: int) -> int:
    """Return ``most``, or less if the process may open fewer files. The limit is raised to its maximum."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft < hard:
        resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    return max(1, min(most, hard - _SPARE_FILES)) if hard != resource.RLIM_INFINITY else most
