"""Robot descriptions in packages of other people, none written for this product."""

import sysconfig
import zipfile
from pathlib import Path

import pytest

from strangers.survey import surveyed, urdf_files

pytestmark = pytest.mark.test_all

WHEELS = Path(__file__).parents[2] / "build/strangers"
OWN = Path(sysconfig.get_path("platlib")) / "cmeel.prefix/share/example-robot-data/robots"
REFUSED = {
    "husky.urdf": "this is a xacro file and no URDF yet",
    "microtaur.urdf": "'-3.14159 1.57079 0 0', not three numbers",
    "torus_deform.urdf": "the robot has no link",
    "finger_macro.urdf": "the robot has no link",
    "ur3.urdf": "the robot has no link",
    "trifingeredu_stage.urdf": "joint 'base_to_table' has parent 'base_link', but no link is called so",
    "trifinger_stage.urdf": "joint 'base_to_table' has parent 'base_link', but no link is called so",
}
"""Files that their authors would not expect to work: templates, parts of robots, and mistakes."""


def test_their_robots_come_online_and_no_check_covers_less_than_it_says(tmp_path: Path) -> None:
    wheels = sorted(WHEELS.glob("*.whl"))
    assert len(wheels) == len((Path(__file__).parent / "packages.txt").read_text().split()), (
        "make build/strangers/stamp"
    )
    for wheel in wheels:
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(tmp_path / wheel.stem)
    files = urdf_files([tmp_path, OWN])
    results = list(surveyed(files))
    assert len(results) == len(files) > 200
    refused = {Path(each.file).name: each.refusal for each in results if each.refusal}
    assert {name for name in REFUSED if REFUSED[name] in refused.get(name, "")} == REFUSED.keys() == refused.keys()
    assert [each for each in results if each.silent] == []
