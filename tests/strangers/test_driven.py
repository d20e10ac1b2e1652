"""Ten robots of other people are driven over HTTP: limits refuse, motions arrive, stops hold."""

import contextlib
import zipfile
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import pytest

from browser import DCTERMS, LF, ROS, SPATIAL, VOM, Browser, Page
from commanding import begun, ended, post, problem
from running import process
from small_fleet import Place, live, move, number
from strangers.test_packages import WHEELS

pytestmark = [pytest.mark.test_all, pytest.mark.virtual]

DRIVEN = (
    "ur3e/ur3e.urdf",
    "armar6.urdf",
    "vega_1/vega_1.urdf",
    "jvrc1.urdf",
    "laikago/laikago_toes_limits.urdf",
    "kuka_iiwa/model.urdf",
    "franka_panda/panda.urdf",
    "xarm/xarm6_robot.urdf",
    "edu/fingeredu.urdf",
    "urdf/upkie.urdf",
)
JOINTS = 3
"""Joints driven of each robot."""
CLOSE_RAD = 0.02


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("packages")
    for wheel in WHEELS.glob("*.whl"):
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(folder / wheel.stem)
    return sorted(folder.rglob("*.urdf"))


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Place, Browser]]:
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (gateway, browser):
        yield place, browser
        assert "Traceback" not in gateway.output, gateway.output


def _limit(browser: Browser, joint: Page, predicate: object) -> float:
    limits = browser.page(str(joint.one(LF.limits)))
    value = limits.graph.value(limits.graph.value(limits.iri, predicate), VOM.numericalValue)
    return float(str(value))


def _driven(browser: Browser, robot: Page) -> Iterator[tuple[Page, str, float, float]]:
    """Yield joints that can be rotated between limits, with their action and these limits."""
    for url in sorted(map(str, robot.graph.objects(robot.iri, DCTERMS.hasPart))):
        joint = browser.page(url)
        with contextlib.suppress(AssertionError, ValueError):  # no such action, or no limit
            action = browser.action(joint, LF.Rotate)
            yield joint, action, _limit(browser, joint, LF.lowerLimit), _limit(browser, joint, LF.upperLimit)


@pytest.mark.parametrize("name", DRIVEN)
def test_a_strangers_robot_is_driven(name: str, files: list[Path], place: tuple[Place, Browser]) -> None:
    there, browser = place
    (file,) = [each for each in files if str(each).endswith("/" + name)]
    robot_name = file.stem
    with process("-m", "linked_fleet_agent", f"--robot={robot_name}={file}", "--connect", there.zenoh):
        robot = live(browser, robot_name)
        driven = list(islice(_driven(browser, robot), JOINTS))
        assert driven
        for joint, action, lower, upper in driven:
            assert problem(move(browser, action, upper + 0.1)) == (422, "unprocessable-content")
            target = (lower + upper) / 2 + (upper - lower) / 20
            end = ended(browser, begun(move(browser, action, target)))
            assert end.one(LF.state) == LF.succeeded, end.response.text
            angle = number(browser.page(str(joint.one(ROS.rotation))), SPATIAL.rotationAngle)
            assert angle == pytest.approx(target, abs=CLOSE_RAD)
        assert ended(browser, begun(post(browser, f"{robot.iri}actions/stop"))).one(LF.state) == LF.succeeded
