"""An arm on a floating or planar joint, whose position no agent reports: it works, and nobody is told where it is."""

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from browser import Browser
from running import eventually, process
from small_fleet import Place, live

pytestmark = pytest.mark.virtual
M, RAD = "http://qudt.org/vocab/unit/M", "http://qudt.org/vocab/unit/RAD"
KINDS = ("floating", "planar")
_INERTIAL = '<inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
_BODY = '<collision><origin xyz="0 0 0.15"/><geometry><box size="0.1 0.1 0.3"/></geometry></collision>'
_LIMIT = '<limit lower="-1.5" upper="1.5" velocity="1" effort="50"/>'


def urdf(kind: str) -> str:
    links = "".join(f'<link name="{name}">{_INERTIAL}{_BODY}</link>' for name in ("base", "upper", "tool"))
    turns = "".join(
        f'<joint name="{name}" type="revolute"><origin xyz="0 0 0.4"/><parent link="{parent}"/><child link="{child}"/>'
        f'<axis xyz="0 1 0"/>{_LIMIT}</joint>'
        for name, parent, child in (("j1", "base", "upper"), ("j2", "upper", "tool"))
    )
    virtual = (
        f'<joint name="virtual" type="{kind}"><parent link="odom"/><child link="base"/><axis xyz="0 0 1"/></joint>'
    )
    return f'<robot name="r"><link name="odom"/>{links}{turns}{virtual}</robot>'


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """Yield a browser on a fleet with one such robot of each kind, 20 m apart."""
    place = Place(tmp_path_factory.mktemp("loose"))
    files: dict[str, Path] = {kind: place.state / f"{kind}.urdf" for kind in KINDS}
    for kind, file in files.items():
        file.write_text(urdf(kind))
    robots = [f"--robot={kind}={file}" for kind, file in files.items()]
    with place.gateway() as (_, browser), process("-m", "linked_fleet_agent", *robots, "--connect", place.zenoh):
        for kind in KINDS:
            live(browser, kind)
        yield browser


def turn(browser: Browser, robot: str, prefer: str) -> httpx.Response:
    def answered() -> httpx.Response | None:
        body = {"value": 0.5, "unit": RAD}
        answer = browser.http.post(
            f"{browser.root}{robot}/j2/actions/rotate?as=json", json=body, headers={"prefer": prefer}
        )
        return None if answer.status_code == 503 else answer

    return eventually(answered, "an answer that is not 503")


def put_placement(browser: Browser, robot: str, x: float, **more: object) -> None:
    where = {"position": {"x": x, "y": 0, "z": 0, "unit": M}}
    assert browser.http.put(f"{browser.root}{robot}/placement", json=where | more).status_code in (200, 204)


@pytest.mark.parametrize("kind", KINDS)
def test_poses_relative_to_the_base_are_known_and_others_are_not(browser: Browser, kind: str) -> None:
    def pose(of: str, frame: str) -> str:
        query = {"of": f"{browser.root}{kind}/{of}", "in": f"{browser.root}{kind}/{frame}"}
        return browser.http.get(f"{browser.root}world/pose", params=query).text

    assert "0.8" in pose("tool", "base") and "unknown" not in pose("tool", "base")
    assert "unknown" in pose("tool", "odom") and "unknown" in pose("base", "odom")


@pytest.mark.parametrize("kind", KINDS)
def test_the_arm_moves_alone_and_is_refused_beside_others_unless_that_is_accepted(browser: Browser, kind: str) -> None:
    other = next(each for each in KINDS if each != kind)
    browser.http.delete(f"{browser.root}{other}/placement")
    put_placement(browser, kind, 0.0)
    rehearsed = turn(browser, kind, "dry-run")
    assert rehearsed.status_code == 200, rehearsed.text
    assert [each["link"].rpartition("/")[2] for each in rehearsed.json()["unchecked"]] == ["base", "upper", "tool"]
    assert f"the {kind} joint virtual, whose position is unknown" in rehearsed.text
    assert turn(browser, kind, "return=representation").status_code == 201
    put_placement(browser, other, 20.0)
    refused = turn(browser, kind, "dry-run")
    assert refused.status_code == 409 and refused.json()["type"].endswith("#unchecked-links"), refused.text
    for robot, x in ((kind, 0.0), (other, 20.0)):
        put_placement(browser, robot, x, acceptsUnchecked=True)
    assert turn(browser, kind, "dry-run").status_code == 200


@pytest.mark.parametrize("kind", KINDS)
def test_the_arm_reaches_a_point_in_the_frame_of_its_base(browser: Browser, kind: str) -> None:
    """A point in the frame of the root is refused, because nobody knows where that is."""
    browser.http.delete(f"{browser.root}{kind}/placement")
    body = {"link": f"{browser.root}{kind}/tool", "position": {"x": 0.2, "y": 0, "z": 0.7464, "unit": M}}

    def reach(**more: str) -> httpx.Response:
        address, dry = f"{browser.root}{kind}/actions/reach?as=json", {"prefer": "dry-run"}
        return browser.http.post(address, json=body | more, headers=dry)

    refused = reach()
    assert refused.status_code == 409, refused.text
    assert all(word in refused.json()["detail"] for word in ("joint 'virtual' is unknown", "link 'base'", "lf:frame"))
    reached = reach(frame="base")
    assert reached.status_code == 200, reached.text
    (turned,) = [each["value"] for each in reached.json()["target"] if each["joint"].endswith("/j1")]
    assert turned == pytest.approx(0.5236, abs=1e-3)  # 0.4 m at 30° to the vertical
