"""The limit of running motions of one client, counted locally, without queries to other gateways."""

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from linked_fleet_gateway.base.errors import TooManyInvocations
from linked_fleet_gateway.fleet.invocations import Invocations


class Quota:
    """Allows ``most`` running motions per client. Those of other gateways count as soon as they are known here."""

    def __init__(self, invocations: Invocations, most: int) -> None:
        self._invocations, self._most = invocations, most
        self._beginning: Counter[str] = Counter()

    def is_full(self, client: str) -> bool:
        return self._invocations.motions_by(client) + self._beginning[client] >= self._most

    def refusal(self, client: str) -> TooManyInvocations:
        return TooManyInvocations(
            f"{client or 'The client'} has as many motions that have not ended as it may have, {self._most}. "
            "Wait until some have ended, cancel them, or move several joints by one motion."
        )

    @contextmanager
    def beginning(self, client: str) -> Iterator[bool]:
        """Count a motion that is being started, and yield True if the client has reached its limit."""
        full = self.is_full(client)
        self._beginning[client] += 1
        try:
            yield full
        finally:
            self._beginning[client] -= 1
            if not self._beginning[client]:
                del self._beginning[client]
