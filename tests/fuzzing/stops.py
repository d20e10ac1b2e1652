"""Repeated stops of a robot while the gateway is fuzzed, which must be answered in time."""

import contextlib
import threading
import time
from collections.abc import Iterator

import httpx

STOP = "arm/actions/stop"
LATE_S = 2.0
"""On a busy machine; robots hold 2.5 s after a gateway has gone."""
_PAUSE_S = 0.1
_PATIENCE_S = 20.0


class Stops:
    """Stops in a thread of its own. ``late_s`` and ``note`` may be called from any thread."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._took_s: list[float] = []
        self._seen = 0

    def run(self, over: threading.Event) -> None:
        with httpx.Client(timeout=_PATIENCE_S) as http:
            while not over.wait(_PAUSE_S):
                begun_s = time.monotonic()
                with contextlib.suppress(httpx.TransportError):  # a failure counts with its duration
                    http.post(self._url)
                self._took_s.append(time.monotonic() - begun_s)

    def late_s(self) -> float:
        """Return the longest response time above LATE_S since the last call, else zero."""
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
