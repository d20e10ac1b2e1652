"""Runs of missions on a terminal: the tree of steps with their states, or a line for each change."""

import re
import shutil
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from typing import Any

from linked_fleet_client.cli import output
from linked_fleet_client.mission import RunState, StepState
from linked_fleet_client.vocabulary import local_name

_MARKS = {"succeeded": "✓", "failed": "✗", "cancelled": "-", "skipped": ">", "waiting": "?", "unknown": "!"}
_RUNNING, _AHEAD = "*", " "
_ROUND = re.compile(r"#(\d+)")
_MOST_LINES = 200
Json = Mapping[str, Any]


def state_json(state: RunState) -> dict[str, Any]:
    """Return a state of a run for scripts."""
    return asdict(state)


class Lines:
    """Prints a line for each step that has another state, or for each change the whole state as JSON."""

    def __init__(self, as_json: bool) -> None:
        self._as_json, self._before = as_json, RunState("", "", (), ())

    def show(self, state: RunState) -> None:
        if self._as_json:
            print(output.as_json(state_json(state)), flush=True)
            return
        before, now = {each.path: each for each in self._before.steps}, time.strftime("%H:%M:%S")
        changed = [_line(each) for each in state.steps if _told(before.get(each.path)) != _told(each)]
        changed += [f"note: {each}" for each in state.notes if each not in self._before.notes]
        changed += [f"the run is {state.state}"] if state.state != self._before.state else []
        self._before = state
        for each in changed:
            print(output.clean(f"{now}  {each}"), flush=True)


def _told(step: StepState | None) -> tuple[str, int, str] | None:
    return None if step is None else (step.state, step.attempt, step.reason)


def _line(step: StepState) -> str:
    again = f" (attempt {step.attempt})" if step.attempt > 1 else ""
    why = f": {step.reason}" if step.reason else ""
    return f"{step.path}  {step.title or step.kind.removesuffix('Step').lower()}  {step.state}{again}{why}"


class Tree:
    """The tree of a mission's steps on a terminal, drawn again at each change."""

    def __init__(self, mission: Json) -> None:
        self._mission, self._drawn = mission, 0

    def show(self, state: RunState) -> None:
        room = shutil.get_terminal_size()
        drawn = [output.clean(line)[: room.columns - 1] for line in tree_lines(self._mission, state)]
        drawn = drawn[: max(room.lines - 2, 1)]
        back = f"\x1b[{self._drawn}F\x1b[J" if self._drawn else ""
        sys.stdout.write(back + "".join(f"{line}\n" for line in drawn))
        sys.stdout.flush()
        self._drawn = len(drawn)


def tree_lines(mission: Json, state: RunState) -> list[str]:
    """Return the lines of a tree: steps with their latest states, then what the run tells people."""
    latest = {_ROUND.sub("", each.path): each for each in state.steps}
    lines = [f"{mission.get('title', '')}: {state.state}{f': {state.reason}' if state.reason else ''}"]
    lines += list(_below(mission["step"], "0", 1, latest))[:_MOST_LINES]
    return lines + [f"  note: {each}" for each in state.notes]


def _below(step: Json, path: str, depth: int, latest: Mapping[str, StepState]) -> Iterator[str]:
    found = latest.get(path)
    mark = _AHEAD if found is None else _MARKS.get(found.state, _RUNNING)
    why = f": {found.reason}" if found is not None and found.reason else ""
    rounds = _ROUND.findall(found.path) if found is not None else []
    round_ = f" (round {int(rounds[-1]) + 1})" if rounds else ""
    yield f"{mark} {'  ' * depth}{_label(step)}{round_}{why}"
    below = [step["step"]] if "step" in step else step.get("steps", [])
    for number, each in enumerate(below):
        yield from _below(each, f"{path}.{number}", depth + 1, latest)


def _label(step: Json) -> str:
    """Return what a step is called, or else what it does."""
    if named := step.get("title") or step.get("name"):
        return str(named)
    kind = str(step.get("type", ""))
    if kind == "invoke":
        of = step.get("of", "")
        return _acted(str(step["action"])) if "action" in step else f"{local_name(str(step.get('kind', '')))} of {of}"
    told = [str(step[each]) for each in ("text", "seconds", "until", "condition", "times") if each in step]
    return f"{kind} {told[0]}".strip() if told else kind


def _acted(action: str) -> str:
    """Return the thing and the name of an action, such as ``wrist_1_joint rotate``."""
    parts = [each for each in action.split("/") if each]
    return f"{parts[-3]} {parts[-1]}" if parts[-2:-1] == ["actions"] and len(parts) > 2 else action
