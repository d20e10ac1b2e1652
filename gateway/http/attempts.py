"""How often an address may fail to log in."""

import time
from collections import OrderedDict

from gateway.errors import TooManyLogins

MOST = 10
"""Failures in a row; then one more every ``REFILL_S``."""
REFILL_S = 6.0
_MOST_ADDRESSES = 10_000


class Attempts:
    """Counts failures by address, of which the latest are remembered."""

    def __init__(self) -> None:
        self._failures: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def check(self, address: str) -> None:
        """TooManyLogins."""
        failures = self._present(address)
        if failures > MOST - 1:
            wait_s = int((failures - MOST + 1) * REFILL_S) + 1
            raise TooManyLogins(f"Try again in {wait_s} s.", retry_after_s=wait_s)

    def failed(self, address: str) -> None:
        self._failures[address] = (self._present(address) + 1, time.monotonic())
        self._failures.move_to_end(address)
        if len(self._failures) > _MOST_ADDRESSES:
            self._failures.popitem(last=False)

    def _present(self, address: str) -> float:
        failures, since_s = self._failures.get(address, (0.0, 0.0))
        return max(0.0, failures - (time.monotonic() - since_s) / REFILL_S)
