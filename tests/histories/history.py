"""A history of operations: what each client asked for, when, and what it was told, if anything.

The checker (``checker/``) reads it as JSON lines. An operation that got no answer, because its connection was lost, its
client was cancelled or its gateway died, has no end: it may take effect at any time after its call, or never.
"""

import itertools
import json
import time
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any


class Operation:
    """One operation that was called; it stays open until ``answered``."""

    def __init__(self, history: "History", line: dict[str, Any], lasting: bool) -> None:
        self._history, self.line, self._lasting = history, line, lasting

    def answered(self, **output: Any) -> None:
        """Note the answer, which came just now. ``is_`` is the word for what was done."""
        self.line |= {"return": self._history.now_ns(), "output": _plain(output)}
        self._history.answered += 1
        self._history.open[self.line["key"]] -= self._lasting

    def never_was(self) -> None:
        """Take the operation back."""
        self._history.open[self.line["key"]] -= self._lasting
        self._lasting = False

    @property
    def matters(self) -> bool:
        """Return False for a question without an answer: it tells nothing, and changed nothing."""
        return self._lasting or self.line["return"] is not None


class History:
    """Operations in the order of their calls. ``clock`` gives nanoseconds that never run backwards."""

    def __init__(self, clock: Callable[[], int] = time.monotonic_ns) -> None:
        self._clock = clock
        self._operations: list[Operation] = []
        self._labels = itertools.count(1)
        self.answered = 0
        """Operations that were answered."""
        self.open: Counter[str] = Counter()
        """Operations that may take effect and have no answer yet, by key."""

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return (each.line for each in self._operations if each.matters)

    def label(self, prefix: str) -> str:
        """A text that this history has nowhere else."""
        return f"{prefix}{next(self._labels)}"

    def asks(self, client: int, model: str, key: str, do: str, **details: Any) -> Operation:
        """Begin an operation that changes nothing."""
        return self._begin(client, model, key, {"do": do, **details}, lasting=False)

    def calls(self, client: int, model: str, key: str, do: str, **details: Any) -> Operation:
        """Begin an operation that may take effect whether or not it is answered."""
        return self._begin(client, model, key, {"do": do, **details}, lasting=True)

    def _begin(self, client: int, model: str, key: str, details: dict[str, Any], *, lasting: bool) -> Operation:
        line = {"client": client, "model": model, "key": key, "call": self._clock(), "return": None}
        operation = Operation(self, {**line, "input": _plain(details), "output": {}}, lasting)
        self._operations.append(operation)
        self.open[key] += lasting
        return operation

    def happened(self, model: str, key: str, do: str, since_ns: int, is_: str = "", **details: Any) -> None:
        """Note what was seen to happen at some time since ``since_ns``, whoever did it."""
        operation = self.calls(0, model, key, do, **details)
        operation.line["call"] = since_ns
        operation.answered(is_=is_)

    def now_ns(self) -> int:
        return self._clock()

    def lines(self) -> str:
        return "".join(json.dumps(line) + "\n" for line in self)


def _plain(fields: dict[str, Any]) -> dict[str, Any]:
    return {name.removesuffix("_"): value for name, value in fields.items() if value is not None}
