"""gateway/linked_fleet_gateway/extensions/things/README.md installs the packages used by the tests."""

import json
import re
from pathlib import Path

_HERE = Path(__file__).parent
_PAGE = _HERE.parents[4] / "gateway/linked_fleet_gateway/extensions/things/README.md"


def test_the_page_pins_the_tested_version() -> None:
    """npm would choose a schema without TD 1.1: the versions of that package are not ordered by date."""
    tested = json.loads((_HERE / "package.json").read_text())["devDependencies"]
    (command,) = re.findall(r"^npm install (.+)$", _PAGE.read_text(), re.MULTILINE)
    pinned = dict(each.rsplit("@", 1) for each in command.split())
    assert len(pinned) == 3 and pinned.items() <= tested.items()
