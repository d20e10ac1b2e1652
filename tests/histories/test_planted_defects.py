"""The same workload on a product with a defect: the checker finds it, and names the key."""

from pathlib import Path
from unittest.mock import patch

import pytest

from histories.checking import Checker
from histories.runs import on_one_server
from linked_fleet_gateway.actions import redis_scripts as scripts

pytestmark = pytest.mark.test_all  # needs Go
OPERATIONS = 1_500
MOST_HISTORIES = 5  # a defect shows only if two clients meet at the right moment, which few do on a busy machine


def without(script: str, part: str, instead: str = "") -> str:
    assert script.count(part) == 1, "the script has changed; plant the defect anew"
    return script.replace(part, instead)


DEFECTS = {
    "a lost update": (
        "SET",
        without(scripts.SET, "if (present and '=' .. present or '') ~= ARGV[3] then return 0 end"),
        "register",
        "setting-",
    ),
    "a doubled command": (
        "OPEN",
        without(scripts.OPEN, "if id and id ~= ARGV[3] then return {'repeated', id} end"),
        "key",
        "key-",
    ),
    "a lease with two owners": (
        "TAKE",
        without(
            without(
                scripts.TAKE,
                "if refusal and not (ARGV[6] == 'person' and refusal[8] == 'program') then return refusal end",
            ),
            "if redis.call('EXISTS', KEYS[1]) == 0 then",
            "if refusal or redis.call('EXISTS', KEYS[1]) == 0 then",
        ),
        "lease",
        "robot-",
    ),
}


@pytest.mark.parametrize(("script", "defective", "model", "key"), DEFECTS.values(), ids=DEFECTS)
def test_rejects(
    checker: Checker, tmp_path: Path, seed: int, script: str, defective: str, model: str, key: str
) -> None:
    with patch.object(scripts, script, defective):
        for number in range(MOST_HISTORIES):
            folder = tmp_path / str(number)
            folder.mkdir()
            verdict = checker.check(on_one_server(folder, seed + number, OPERATIONS))
            if verdict.broken:
                break
    assert verdict.broken == {model}, verdict
    assert all(each["key"].startswith(key) for each in verdict.violations)
    assert all(each["impossible"] for each in verdict.violations)
