"""A base is said to stand somewhere: its odometry frame gets the placement at which it does."""

import math
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
import rdflib

from authenticated_gateway import AuthenticatedGateway, run_authenticated
from browser import LF, MATHS, Browser
from linked_fleet_agent.robots.of_components import RobotOfComponents
from linked_fleet_agent.wire.messages import Base
from linked_fleet_state.model import Pose
from running import eventually
from virtual.processes import serving_robot

pytestmark = pytest.mark.virtual
M, MM, RAD, DEG = (f"http://qudt.org/vocab/unit/{each}" for each in ("M", "MilliM", "RAD", "DEG"))
_URDF = (
    '<robot name="cart"><link name="base"/><link name="sensor"/><joint name="mast" type="fixed"><parent link="base"/>'
    '<child link="sensor"/><origin xyz="0.5 0 1"/></joint></robot>'
)


def flat(x: float, y: float, heading: float, z: float = 0.0) -> Pose:
    return Pose((x, y, z), (0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2)))


class Cart:
    """A robot whose odometry says what the test sets."""

    def __init__(self) -> None:
        self.odometry = flat(0.0, 0.0, 0.0)
        self.robot = RobotOfComponents("Cart", urdf=_URDF, measure_base=self._read)

    def _read(self) -> Base:
        return Base(self.odometry.position_m, self.odometry.orientation_xyzw, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


@pytest.fixture
def cart() -> Cart:
    return Cart()


@pytest.fixture
def here(cart: Cart, tmp_path: Path) -> Iterator[AuthenticatedGateway]:
    with run_authenticated(tmp_path, robots=False) as here, serving_robot(here.place.zenoh, "cart", cart.robot):
        yield here


@pytest.fixture
def browser(here: AuthenticatedGateway) -> Iterator[Browser]:
    with here.browsing("root") as browser:
        eventually(lambda: offered(browser).status_code == 200, "the action")
        eventually(lambda: "unknown" not in browser.http.get(f"{browser.root}cart/pose").text, "the odometry")
        yield browser


def offered(browser: Browser) -> httpx.Response:
    return browser.http.get(f"{browser.root}cart/actions/relocalise")


def relocalise(browser: Browser, x: float, y: float, degrees: float, **fields: str) -> httpx.Response:
    where = {"position": {"x": 1000 * x, "y": 1000 * y, "unit": MM}, "heading": {"value": degrees, "unit": DEG}}
    return browser.http.post(f"{browser.root}cart/actions/relocalise", json=where, headers=fields)


def pose(browser: Browser, of: str) -> tuple[float, ...]:
    """Return x, y and z of a part of the robot in the world."""
    answer = browser.http.get(f"{browser.root}world/pose", params={"of": browser.root + of})
    graph = rdflib.Graph().parse(data=answer.text, format="turtle", publicID=str(answer.url))
    (node,) = graph.objects(None, LF.position)
    return tuple(float(str(graph.value(node, axis))) for axis in (MATHS.x, MATHS.y, MATHS.z))


def test_a_drifted_base_is_put_right_with_all_its_links(browser: Browser, cart: Cart) -> None:
    """And stays right while it drives on: its odometry frame has moved, not the robot."""
    cart.odometry = flat(3.0, 1.0, math.pi / 2)
    eventually(lambda: '"3.0"' in browser.http.get(f"{browser.root}cart/pose").text, "the odometry")
    assert relocalise(browser, 5.0, -2.0, 180.0).status_code == 204
    eventually(lambda: pose(browser, "cart/") == pytest.approx((5.0, -2.0, 0.0), abs=1e-4), "the base there")
    assert pose(browser, "cart/sensor") == pytest.approx((4.5, -2.0, 1.0), abs=1e-4)
    cart.odometry = flat(3.0, 2.0, math.pi / 2)  # a metre on, as it looks
    eventually(lambda: pose(browser, "cart/") == pytest.approx((4.0, -2.0, 0.0), abs=1e-4), "the base further on")


def test_what_the_placement_accepts_stays_accepted_and_its_height_too(browser: Browser) -> None:
    placement = {"position": {"x": 0, "y": 0, "z": 0.25, "unit": M}, "acceptsUnchecked": True}
    assert browser.http.put(f"{browser.root}cart/placement", json=placement).status_code == 204
    assert relocalise(browser, 1.0, 2.0, 0.0).status_code == 204
    said = browser.http.get(f"{browser.root}cart/placement", headers={"accept": "application/json"}).json()
    assert said["acceptsUnchecked"] is True
    assert [said["position"][axis] for axis in "xyz"] == pytest.approx([1.0, 2.0, 0.25])


def test_a_rehearsal_changes_nothing(browser: Browser) -> None:
    assert relocalise(browser, 1.0, 2.0, 0.0, prefer="dry-run").status_code == 200
    assert "unknown" in browser.http.get(f"{browser.root}cart/placement").text


def test_it_takes_the_right_to_place_and_is_noted_in_the_audit(here: AuthenticatedGateway, browser: Browser) -> None:
    here.add("mover", "read", "act")
    here.add("placer", "read", "admin")
    here.known("placer")
    with here.browsing("mover") as mover, here.browsing("placer") as placer:
        assert relocalise(mover, 1.0, 2.0, 0.0).status_code == 403
        assert relocalise(placer, 1.0, 2.0, 0.0).status_code == 204
    noted = eventually(
        lambda: "204" in (text := browser.http.get(f"{browser.root}audit").text) and text, "the entry of the audit"
    )
    assert "POST /cart/actions/relocalise" in noted and "placer" in noted


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ({"position": {"x": 1, "y": 1, "unit": M}}, "heading"),
        ({"position": {"x": 1, "y": 1, "z": 0, "unit": M}, "heading": {"value": 0, "unit": RAD}}, "z"),
        ({"position": {"x": 1, "y": 1, "unit": RAD}, "heading": {"value": 0, "unit": RAD}}, "unit"),
        ({"position": {"x": 5000, "y": 1, "unit": M}, "heading": {"value": 0, "unit": RAD}}, "within 1000 m"),
    ],
)
def test_a_place_that_is_none_is_refused_with_a_sentence(browser: Browser, body: object, words: str) -> None:
    answer = browser.http.post(f"{browser.root}cart/actions/relocalise", json=body)
    assert answer.status_code in (409, 422) and words in answer.json()["detail"], answer.text


def test_a_base_whose_pose_is_unknown_has_no_frame_to_be_placed(browser: Browser, cart: Cart) -> None:
    cart.odometry = Pose((math.nan, math.nan, math.nan), (0.0, 0.0, 0.0, 1.0))
    eventually(lambda: "unknown" in browser.http.get(f"{browser.root}cart/pose").text, "the odometry lost")
    answer = relocalise(browser, 1.0, 2.0, 0.0)
    assert answer.status_code == 409 and "no known pose" in answer.json()["detail"], answer.text
