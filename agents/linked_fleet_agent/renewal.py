"""Decides when a robot renews its Zenoh declarations. Pure: time is passed in.

Routers whose connection breaks and returns within a tenth of a second may not exchange their declarations again (Zenoh
1.10). Then a gateway does not see a robot, or a robot a gateway, until the declarations are renewed. The robot cannot
tell this from a gateway that has ended: it only sees that tokens of gateways go and come.
"""

import math

RENEW_S = 5.0
"""Delay from the last such event to the renewal. It doubles while a gateway is missing."""
LONGEST_S = 60.0
FORGOTTEN_S = 3600.0
"""A gateway that has been gone for this long no longer counts as missing."""
MAX_MISSING = 256


class Renewal:
    """Renewal times of a robot that starts at ``now_s``. A gateway is missing from ``left`` to ``appeared``."""

    def __init__(self, now_s: float) -> None:
        self._settled_s = now_s + RENEW_S
        self._missing: dict[str, float] = {}
        self._alive = False
        self._wait_s, self._due_s = RENEW_S, math.inf

    def appeared(self, gateway: str, now_s: float) -> None:
        missing = self._missing.pop(gateway, None) is not None
        if missing or (not self._alive and now_s >= self._settled_s):
            self._begin(now_s)

    def left(self, gateway: str, now_s: float) -> None:
        if len(self._missing) < MAX_MISSING:
            self._missing[gateway] = now_s
        self._begin(now_s)

    def due(self, now_s: float, alive: bool) -> bool:
        """Return True if the robot must renew its declarations now. Call it periodically.

        ``alive`` says that some gateway is alive. While none is, renewals are scheduled as while one is missing.
        """
        self._alive = alive
        if not alive and self._due_s == math.inf and now_s >= self._settled_s:
            self._begin(now_s)
        if now_s < self._due_s:
            return False
        self._missing = {name: left_s for name, left_s in self._missing.items() if now_s < left_s + FORGOTTEN_S}
        self._wait_s = min(2 * self._wait_s, LONGEST_S)
        self._due_s = now_s + self._wait_s if self._missing or not alive else math.inf
        return True

    def _begin(self, now_s: float) -> None:
        self._wait_s, self._due_s = RENEW_S, now_s + RENEW_S
