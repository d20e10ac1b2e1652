"""The page of what operators do with the pages, with clicks and seconds (`make tasks`)."""

import ast
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

TESTS = Path(__file__).parents[1] / "gateway/linked_fleet_gateway/extensions/pages/tests"
PAGE = Path(__file__).with_name("TASKS.md")
SIZES = ("desk", "phone")
_HEAD = (
    "| task | at most | clicks on a desktop | seconds | taps on a phone | seconds | test |\n"
    + f"|---|{5 * '--:|'}---|\n"
)


class Task(NamedTuple):
    """A task of an operator, in at most so many presses, as a test shows."""

    name: str
    presses: int
    test: str


def marked() -> Sequence[Task]:
    """Return the tasks by the marks of their tests, in the order of their names."""
    return sorted(each for file in TESTS.glob("test_*.py") for each in _in(file))


def _in(file: Path) -> Iterator[Task]:
    for node in ast.parse(file.read_text()).body:
        if not isinstance(node, ast.FunctionDef):
            continue
        for mark in node.decorator_list:
            if isinstance(mark, ast.Call) and ast.unparse(mark.func) == "pytest.mark.task":
                (most,) = (ast.literal_eval(each.value) for each in mark.keywords if each.arg == "presses")
                yield Task(ast.literal_eval(mark.args[0]), most, f"{file.name}::{node.name}")


def page(text: str, measured: Mapping[tuple[str, str], Mapping[str, Any]]) -> str:
    """Return the page with what was ``measured``, by task and size; ``text`` is the existing page."""
    rows = []
    for task in marked():
        found = [measured[task.name, size] for size in SIZES]
        figures = " | ".join(f"{each['presses']} | {each['seconds']:.1f}" for each in found)
        rows.append(f"| {task.name} | {task.presses} | {figures} | `{task.test}` |\n")
    return text.partition(_HEAD)[0] + _HEAD + "".join(rows)


if __name__ == "__main__":
    said = [json.loads(line) for line in Path(sys.argv[1]).read_text().splitlines()]
    PAGE.write_text(page(PAGE.read_text(), {(each["task"], each["size"]): each for each in said}))
