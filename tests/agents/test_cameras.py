"""Cameras of a simulated robot: requests judged, pictures rendered, correct depths, and robots without a renderer."""

import math
import struct
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path

import pytest

from linked_fleet_agent.publications import Cameras
from linked_fleet_agent.robot import Facts, PictureError, Reading
from linked_fleet_agent.robots import camera_client
from linked_fleet_agent.robots.camera_client import Probe, Renderer, Scene, probe, with_availability
from linked_fleet_agent.robots.mujoco_robot import MujocoRobot
from linked_fleet_agent.urdf import joints_of
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.codec import decode_picture
from linked_fleet_agent.wire.messages import Camera, PictureQuery, State

HEIGHT_M, DOWN_RAD, FIELD_RAD = 1.5, 0.8, 1.0
ROWS, COLUMNS = 60, 80
# A mast with a camera that turns about y: its optical axis (z) is level at 0 and points down at positive angles.
URDF = f"""<robot name="mast"><link name="base"/><link name="eye"/>
<joint name="tilt" type="revolute"><parent link="base"/><child link="eye"/><origin xyz="0 0 {HEIGHT_M}"/>
<axis xyz="0 1 0"/><limit lower="-1.5" upper="1.5" velocity="1" effort="10"/></joint></robot>"""
# z of the optical frame along x of the link, x to the right (-y), y down (-z).
CAMERA = Camera(
    name="eye", link="eye", orientation_xyzw=(-0.5, 0.5, -0.5, 0.5), width=COLUMNS, height=ROWS,
    vertical_fov_rad=FIELD_RAD, near_m=0.05, far_m=10.0,
)  # fmt: skip


def mast(reason: str = "", way: str = "") -> MujocoRobot:
    facts = Facts("mast", URDF, joints_of(URDF), cameras=with_availability((CAMERA,), reason))
    return MujocoRobot("mast", facts, renders_by=way)


@pytest.fixture(scope="module")
def seeing() -> Iterator[MujocoRobot]:
    way, reason = probe().result
    if reason:
        pytest.skip(reason)
    robot = mast(way=way)
    yield robot
    robot.close()


def shown(tilt_rad: float) -> State:
    return State(
        incarnation=3, sequence=9, monotonic_ns=1, wall_ns=2, positions=(tilt_rad,), velocities=(0.0,), efforts=(0.0,)
    )


def question(camera: str = "eye", format: str = "depth") -> bytes:
    return codec.encode(PictureQuery(version=1, camera=camera, format=format))  # type: ignore[arg-type]


def test_depths_are_those_of_the_floor(seeing: MujocoRobot) -> None:
    """The floor is HEIGHT_M / sin(DOWN_RAD + a) away along the ray of a pixel ``a`` below the optical axis.

    The axis points DOWN_RAD below level; the depth along the axis is cos(a) of that distance.
    """
    cameras = Cameras(seeing, seeing.describe().cameras)
    moment, content = decode_picture(cameras.take(question(), shown(DOWN_RAD)), "depth")
    assert (moment.rows, moment.columns, moment.sequence, moment.far_m) == (ROWS, COLUMNS, 9, 10.0)
    depths = struct.unpack(f"<{ROWS * COLUMNS}f", content)
    focal = ROWS / 2 / math.tan(FIELD_RAD / 2)
    for row in (0, 10, 30, 59):
        below = math.atan2(row + 0.5 - ROWS / 2, focal)
        expected = HEIGHT_M * math.cos(below) / math.sin(DOWN_RAD + below)
        for column in (0, 40, 79):
            assert depths[row * COLUMNS + column] == pytest.approx(expected, rel=2e-3)


def test_depth_out_of_range_is_nan(seeing: MujocoRobot) -> None:
    cameras = Cameras(seeing, seeing.describe().cameras)
    _, content = decode_picture(cameras.take(question(), shown(-DOWN_RAD)), "depth")
    assert all(map(math.isnan, struct.unpack(f"<{ROWS * COLUMNS}f", content)))


@pytest.mark.parametrize("format", ["jpeg", "png"])
def test_pictures_show_the_robot_as_it_is_said_to_be(seeing: MujocoRobot, format: str) -> None:
    image = pytest.importorskip("PIL.Image")
    cameras = Cameras(seeing, seeing.describe().cameras)
    means = []
    for tilt_rad in (-DOWN_RAD, DOWN_RAD):
        _, content = decode_picture(cameras.take(question(format=format), shown(tilt_rad)), format)  # type: ignore[arg-type]
        picture = image.open(BytesIO(content))
        assert (picture.format, picture.size) == (format.upper(), (COLUMNS, ROWS))
        red, _, blue = picture.resize((1, 1)).convert("RGB").getpixel((0, 0))
        means.append(blue - red)
    assert means[0] > 2 * means[1]  # the sky is bluer than the floor


def test_a_renderer_that_ended_is_started_again(seeing: MujocoRobot) -> None:
    cameras = Cameras(seeing, seeing.describe().cameras)
    before = cameras.take(question(format="png"), shown(0.3))
    renderer = seeing._renderer
    assert renderer is not None and renderer._renderer is not None
    renderer._renderer.close()
    assert cameras.take(question(format="png"), shown(0.3)) == before


def test_no_renderer_is_started_for_an_agent_that_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """It ends while a picture is being taken in another thread, whose process it kills."""
    started = 0

    class Process:
        ended = False

        def __init__(self, *_: str) -> None:
            nonlocal started
            started += 1
            self.asked = 0

        def ask(self, _: bytes) -> bytes:
            self.asked += 1
            if self.asked == 1:
                return b""  # it has the scene
            renderer.close()
            raise EOFError

        def close(self) -> None: ...

    monkeypatch.setattr(camera_client, "_Renderer", Process)
    scene = Scene(robot="r", urdf="", file="", floating=False, home={}, cameras=())
    renderer = Renderer(scene, "egl")
    with pytest.raises(PictureError):
        renderer.take("eye", "png", Reading((), (), ()), ())
    assert started == 1


@pytest.mark.parametrize(
    ("asked", "reading", "why"),
    [
        (b"nonsense", shown(0), "not a picture query"),
        (question("other"), shown(0), "camera 'other'"),
        (question(), None, "cannot be measured"),
        (question(), shown(math.nan), "cannot be measured"),
    ],
)
def test_an_impossible_picture_is_refused_with_a_reason(asked: bytes, reading: State | None, why: str) -> None:
    robot = mast()
    with pytest.raises(PictureError, match=why):
        Cameras(robot, robot.describe().cameras).take(asked, reading)


@pytest.mark.parametrize("way", ["disabled", "no-such-way-to-opengl"])
def test_without_a_renderer_there_is_a_reason_and_a_robot_all_the_same(way: str) -> None:
    """OpenGL is requested in ways that no machine supports."""
    found, reason = Probe(way).result
    assert (found, bool(reason)) == ("", True)
    robot = mast(reason)
    [camera] = robot.describe().cameras
    assert (camera.formats, camera.unavailable) == ((), reason)
    with pytest.raises(PictureError, match="is available"):
        Cameras(robot, robot.describe().cameras).take(question(), shown(0))
    assert robot.read(0.0).positions == (0.0,)


def test_the_cameras_of_the_catalogue_sit_on_links_of_their_robots() -> None:
    from linked_fleet_agent.robots.catalogue import MODELS, data_folder

    for model in MODELS.values():
        urdf = Path(data_folder() / model.file).read_text()
        assert all(f'<link name="{camera.link}"' in urdf for camera in model.cameras)
    assert sum(bool(model.cameras) for model in MODELS.values()) >= 2
