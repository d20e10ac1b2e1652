"""README.md names every helper, and only those."""

import re
from pathlib import Path

HERE = Path(__file__).parent
_NO_HELPERS = ("test_*", "__init__.py", "README.md", "*.pyc")


def test_the_page_names_every_helper_once() -> None:
    named = re.findall(r"`([\w/.]+)`", "\n".join(re.findall(r"^\| (`.+?) \|", (HERE / "README.md").read_text(), re.M)))
    files = [path for path in HERE.rglob("*") if path.is_file() and not any(map(path.match, _NO_HELPERS))]
    assert sorted(named) == sorted(str(path.relative_to(HERE)) for path in files)
