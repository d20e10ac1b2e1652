"""Reads during a failure, and the outcomes that are permitted."""

import threading
from collections.abc import Callable, Sequence
from http.client import OK, HTTPException

from front import TruncatedResponseError

ANSWERED, TRUNCATED = "answered", "broken off"


class RepeatedReads:
    """A client that reads repeatedly until ``stop`` is called; ``read`` returns the status code."""

    def __init__(self, read: Callable[[], int]) -> None:
        self._read, self._over = read, threading.Event()
        self._outcomes: list[str] = []
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def stop(self) -> list[str]:
        """Return the outcome of each read, in order."""
        self._over.set()
        self._thread.join()
        return self._outcomes

    def _run(self) -> None:
        while not self._over.is_set():
            self._outcomes.append(self._outcome())

    def _outcome(self) -> str:
        try:
            status = self._read()
        except TruncatedResponseError:
            return TRUNCATED
        except (OSError, HTTPException) as error:
            return repr(error)
        return ANSWERED if status == OK else str(status)


def describe_violation(outcomes: Sequence[str]) -> str:
    """Describe the first violation of the promise about reads while one gateway ends; empty if there is none.

    The front repeats a read whose response has not begun, but cannot take back what it has forwarded: the one read in
    progress may break off in its body, and the next one must be answered.
    """
    failed = [outcome for outcome in outcomes if outcome not in (ANSWERED, TRUNCATED)]
    if failed:
        return f"{len(failed)} of {len(outcomes)} reads failed, the first with {failed[0]}"
    broken = [index for index, outcome in enumerate(outcomes) if outcome == TRUNCATED]
    if len(broken) > 1:
        return f"{len(broken)} of {len(outcomes)} reads broke off; one gateway answers one of them at a time"
    if not outcomes or outcomes[-1] != ANSWERED:
        return f"no read was answered at the end, of {len(outcomes)}"
    return ""
