"""Somebody stops a robot again and again while the gateway is fuzzed, and is to be answered in time."""

import contextlib
import threading
import time
from collections.abc import Iterator

import httpx

STOP = "arm/actions/stop"
LATE_S = 2.0
"""On a machine that does other things too; robots hold 2.5 s after a gateway has gone."""
_PAUSE_S = 0.1
_PATIENCE_S = 20.0


class Stops:
    """Asked for in a thread. ``late_s`` and ``note`` may be called at any time from another."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._took_s: list[float] = []
        self._seen = 0

    def run(self, over: threading.Event) -> None:
        with httpx.Client(timeout=_PATIENCE_S) as http:
            while not over.wait(_PAUSE_S):
                begun_s = time.monotonic()
                with contextlib.suppress(httpx.TransportError):  # as late as it took to fail
                    http.post(self._url)
                self._took_s.append(time.monotonic() - begun_s)

    def late_s(self) -> float:
        """The longest above LATE_S of those that were answered since the last time, else zero."""
        recent = self._took_s[self._seen :]
        self._seen += len(recent)
        longest_s = max(recent, default=0.0)
        return longest_s if longest_s > LATE_S else 0.0

    def note(self) -> str:
        took_s = sorted(self._took_s) or [0.0]
        return f"stops {took_s[len(took_s) // 2] * 1000:.0f} ms, at most {took_s[-1] * 1000:.0f}"


@contextlib.contextmanager
def stopping(url: str) -> Iterator[Stops]:
    stops, over = Stops(url), threading.Event()
    thread = threading.Thread(target=stops.run, args=(over,), name="stops")
    thread.start()
    try:
        yield stops
    finally:
        over.set()
        thread.join()
