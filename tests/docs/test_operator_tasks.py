"""The page of what operators do has the tasks that tests have the mark of."""

import importlib
import re

import pytest

from running import ROOT

FEWEST = 25


def test_the_page_has_each_task_with_its_most_clicks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    script = importlib.import_module("operator_tasks")
    rows = re.findall(
        r"^\| (.+?) \| (\d+) \| (\d+) \| [\d.]+ \| (\d+) \| [\d.]+ \| `(.+?)` \|$", script.PAGE.read_text(), re.M
    )
    assert [(name, int(most), test) for name, most, _, _, test in rows] == [tuple(each) for each in script.marked()]
    assert all(int(each) <= int(most) for _, most, *made, _ in rows for each in made)
    assert len(rows) >= FEWEST
