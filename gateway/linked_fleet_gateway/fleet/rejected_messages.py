"""Counts of rejected messages by sender, in bounded memory, with one log line per sender."""

import logging
from collections import Counter

MAX_SENDERS = 1000
MAX_SENDER = 400
_OTHERS = "(others)"


class Complaints:
    """Counts by sender. Senders beyond the bound share one entry, so that invented names cannot fill memory."""

    def __init__(self, log: logging.Logger) -> None:
        self.counts: Counter[str] = Counter()
        self._log = log

    def add(self, sender: str, reason: object) -> None:
        sender = sender[:MAX_SENDER]  # for a sender that is no robot, this is a key
        if sender not in self.counts and len(self.counts) >= MAX_SENDERS:
            sender = _OTHERS
        self.counts[sender] += 1
        if self.counts[sender] == 1:
            self._log.warning("%.200r sent something that is refused (logged once): %.500s", sender, reason)

    def forget(self, sender: str) -> None:
        """Free the entry of a sender; the sum of all counts stays."""
        count = self.counts.pop(sender, 0)
        if count:
            self.counts[_OTHERS] += count
