"""A history of operations: each client's requests, their times, and the responses, if any.

The checker (``checker/``) reads it as JSON lines. An operation without a response, because its connection was lost, its
client was cancelled or its gateway died, has no end: it may take effect at any time after its call, or never.
"""

import itertools
import json
import time
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any


class Operation:
    """One called operation; it stays open until ``answered``."""

    def __init__(self, history: "History", line: dict[str, Any], lasting: bool) -> None:
        self._history, self.line, self._lasting = history, line, lasting

    def answered(self, **output: Any) -> None:
        """Record the response, which arrived just now. ``is_``: the resulting action."""
        self.line |= {"return": self._history.now_ns(), "output": _plain(output)}
        self._history.answered += 1
        self._history.open[self.line["key"]] -= self._lasting

    def never_was(self) -> None:
        """Withdraw the operation."""
        self._history.open[self.line["key"]] -= self._lasting
        self._lasting = False

    @property
    def matters(self) -> bool:
        """Return False for a read without a response: it reveals nothing, and changed nothing."""
        return self._lasting or self.line["return"] is not None


class History:
    """Operations in the order of their calls. ``clock``: monotonic nanoseconds."""

    def __init__(self, clock: Callable[[], int] = time.monotonic_ns) -> None:
        self._clock = clock
        self._operations: list[Operation] = []
        self._labels = itertools.count(1)
        self.answered = 0
        """Number of operations with a response."""
        self.open: Counter[str] = Counter()
        """Operations by key that may take effect and have no response yet."""

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return (each.line for each in self._operations if each.matters)

    def label(self, prefix: str) -> str:
        """Return a text that is unique in this history."""
        return f"{prefix}{next(self._labels)}"

    def asks(self, client: int, model: str, key: str, do: str, **details: Any) -> Operation:
        """Begin an operation that changes nothing."""
        return self._begin(client, model, key, {"do": do, **details}, lasting=False)

    def calls(self, client: int, model: str, key: str, do: str, **details: Any) -> Operation:
        """Begin an operation that may take effect whether or not it gets a response."""
        return self._begin(client, model, key, {"do": do, **details}, lasting=True)

    def _begin(self, client: int, model: str, key: str, details: dict[str, Any], *, lasting: bool) -> Operation:
        line = {"client": client, "model": model, "key": key, "call": self._clock(), "return": None}
        operation = Operation(self, {**line, "input": _plain(details), "output": {}}, lasting)
        self._operations.append(operation)
        self.open[key] += lasting
        return operation

    def happened(self, model: str, key: str, do: str, since_ns: int, is_: str = "", **details: Any) -> None:
        """Record an event observed at some time since ``since_ns``, whoever caused it."""
        operation = self.calls(0, model, key, do, **details)
        operation.line["call"] = since_ns
        operation.answered(is_=is_)

    def now_ns(self) -> int:
        return self._clock()

    def lines(self) -> str:
        return "".join(json.dumps(line) + "\n" for line in self)


def _plain(fields: dict[str, Any]) -> dict[str, Any]:
    return {name.removesuffix("_"): value for name, value in fields.items() if value is not None}
