"""docs/FAULTS.md names only what is there: each test, each file, and each constant with its value."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "FAULTS.md").read_text()


def test_every_file_that_is_named_exists() -> None:
    named = set(re.findall(r"`((?:tests|gateway|agents)/[\w/]+\.py)`", PAGE))
    assert len(named) > 20
    assert not [name for name in sorted(named) if not (ROOT / name).is_file()]


@pytest.mark.parametrize(
    ("value", "file", "constant"), re.findall(r"\| (\d+) \| `(gateway/[\w/]+\.py)` `(\w+)` \|", PAGE)
)
def test_every_number_is_that_of_its_constant(value: str, file: str, constant: str) -> None:
    found = re.search(rf"^{constant} = ([\d._ *]+)$", (ROOT / file).read_text(), re.MULTILINE)
    assert found, f"{file} has no {constant}"
    numbers = [float(each.replace("_", "")) for each in found[1].split("*")]
    product = 1.0
    for number in numbers:
        product *= number
    assert product == float(value)


def test_every_test_of_faults_is_on_the_page() -> None:
    there = {f"tests/fleet/{each.name}" for each in (ROOT / "tests" / "fleet").glob("test_fault_*.py")}
    assert not sorted(name for name in there if f"`{name}`" not in PAGE)
