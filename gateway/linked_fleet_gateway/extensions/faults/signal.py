"""The debouncing of one trouble at one gateway: thousands of flaps are one fault. Pure; times are wall nanoseconds.

A trouble *appears* when it is seen, and its appearance is over once it has been absent for ``clear_s``. It is confirmed
when it was present for ``confirm_s`` without a break, or was seen ``FLAPS`` times. Trouble that comes and goes within
``clear_s`` is so one appearance, which counts how often it came.
"""

from dataclasses import dataclass
from typing import Literal

from msgspec import Struct

FLAPS = 3
"""Number of times that a trouble is seen in one appearance until it is confirmed, however short each time was."""
Verdict = Literal["absent", "raised", "confirmed"]


class Policy(Struct, frozen=True):
    """Time that a trouble is present until it is confirmed, and absent until it is over, in seconds."""

    confirm_s: float = 0.0
    clear_s: float = 0.0

    @property
    def confirm_ns(self) -> int:
        return int(self.confirm_s * 1e9)

    @property
    def clear_ns(self) -> int:
        return int(self.clear_s * 1e9)


@dataclass
class Signal:
    """A trouble as one gateway sees it. ``since_ns`` is when it last came or went, ``began_ns`` when it appeared."""

    policy: Policy
    present: bool = False
    active: bool = False
    confirmed: bool = False
    since_ns: int = 0
    began_ns: int = 0
    last_ns: int = 0
    """Time at which it last came."""
    count: int = 0
    """Number of times that it came in this appearance."""

    def come(self, now_ns: int) -> None:
        """Note that the trouble is there from now on."""
        self._settle(now_ns)
        if self.present:
            return
        if not self.active:
            self.active, self.confirmed, self.began_ns, self.count = True, False, now_ns, 0
        self.present, self.since_ns, self.last_ns = True, now_ns, now_ns
        self.count += 1

    def go(self, now_ns: int) -> None:
        """Note that the trouble is not there from now on."""
        self._settle(now_ns)
        if self.present:
            self.present, self.since_ns = False, now_ns

    def judge(self, now_ns: int) -> Verdict:
        """Return what is to be believed now."""
        self._settle(now_ns)
        return "confirmed" if self.confirmed else "raised" if self.active else "absent"

    def _settle(self, now_ns: int) -> None:
        """Confirm what was there for long, or often, and end what was absent for long. A clock that was set back is
        awaited.
        """
        past_ns = now_ns - self.since_ns
        if self.active and (self.count >= FLAPS or (self.present and past_ns >= self.policy.confirm_ns)):
            self.confirmed = True
        if self.active and not self.present and past_ns >= self.policy.clear_ns:
            self.active = self.confirmed = False
