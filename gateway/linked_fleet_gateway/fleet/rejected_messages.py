"""Counting what was refused, by sender, in bounded memory, with one log line per sender."""

import logging
from collections import Counter

MAX_SENDERS = 1000
MAX_SENDER = 400
_OTHERS = "(others)"


class Complaints:
    """``counts`` by sender; senders beyond the bound share one entry, so that names cannot be used to fill memory."""

    def __init__(self, log: logging.Logger) -> None:
        self.counts: Counter[str] = Counter()
        self._log = log

    def add(self, sender: str, reason: object) -> None:
        sender = sender[:MAX_SENDER]  # of what is no robot it is a key
        if sender not in self.counts and len(self.counts) >= MAX_SENDERS:
            sender = _OTHERS
        self.counts[sender] += 1
        if self.counts[sender] == 1:
            self._log.warning("%.200r sent something that is refused (logged once): %.500s", sender, reason)

    def forget(self, sender: str) -> None:
        """Make room for another sender; the sum of the counts stays."""
        count = self.counts.pop(sender, 0)
        if count:
            self.counts[_OTHERS] += count
