"""A short animation of the world for README.md: robots that move, seen by a camera that goes round them.

Robots move in steps, each of which has ended and is drawn before its picture is taken: a busy machine takes longer for
the same animation.
"""

from io import BytesIO
from pathlib import Path

from playwright.sync_api import Page

from browser import LF
from browser import Browser as Client
from commanding import PREFIXES, TURTLE, of_robot
from running import eventually

FRAMES = 24
"""There and back: what is shown has twice as many, and no seam."""
SHOWN_MS = 100
WIDTH_PX = 800
_TARGETS = {
    "baxter": {"right_s0": -0.8, "right_e1": 1.6, "left_s0": 0.8, "left_e1": 1.6, "head_pan": 0.8},
    "ur5": {"shoulder_pan_joint": 1.9, "shoulder_lift_joint": -0.9, "elbow_joint": 1.2},
    "panda": {"panda_joint1": 1.6, "panda_joint2": 0.4, "panda_joint4": -1.4},
    "tiago": {"torso_lift_joint": 0.3, "arm_1_joint": 1.6, "arm_2_joint": 0.6},
}
_IN_METRE = ("torso_lift_joint",)
DRAWN = 0.02
"""How near a joint must be drawn to its position, in rad or m."""
# The position of a joint that is drawn.
_DRAWN = """([robot, joint]) => {
    const standing = [...document.getElementById("scene").scene.robots.values()];
    return standing.find(({ iri }) => iri.endsWith(`/${robot}/`)).robot.joints[joint].angle;
}"""
# As well as can be, however slow that is here, and at once.
_TURN = """() => new Promise((resolve) => {
    const { view } = document.getElementById("scene").scene;
    Object.assign(view, { level: 0, slow: 0, untouched: false });
    view.turn(0.014, 0);
    requestAnimationFrame((now) => {
        view.draw(now);
        requestAnimationFrame(resolve);
    });
})"""


def animate(page: Page, client: Client, file: Path) -> None:
    """Write ``file``, an animated WebP, of the page of the fleet, whose scene is drawn."""
    from PIL import Image

    begin = {(robot, joint): _angle(page, robot, joint) for robot, targets in _TARGETS.items() for joint in targets}
    shots = []
    for number in range(FRAMES):
        share = number / (FRAMES - 1)
        for robot, targets in _TARGETS.items():
            there = {joint: (1 - share) * begin[robot, joint] + share * target for joint, target in targets.items()}
            _move(client, robot, there)
            for joint, target in there.items():
                drawn = lambda robot=robot, joint=joint: _angle(page, robot, joint)  # noqa: E731
                eventually(lambda drawn=drawn, target=target: abs(drawn() - target) < DRAWN, f"{joint} at {target}")
        page.evaluate(_TURN)
        shot = Image.open(BytesIO(page.locator("#scene").screenshot())).convert("RGB")
        shots.append(shot.resize((WIDTH_PX, round(shot.height * WIDTH_PX / shot.width)), Image.Resampling.LANCZOS))
    shown = [*shots, *shots[-2:0:-1]]
    shown[0].save(file, save_all=True, append_images=shown[1:], duration=SHOWN_MS, loop=0, quality=72, method=6)


def _angle(page: Page, robot: str, joint: str) -> float:
    return float(page.evaluate(_DRAWN, [robot, joint]))


def _move(client: Client, robot: str, targets: dict[str, float]) -> None:
    """Move joints together, and wait for the end."""
    lines = [
        f"<> lf:target [ lf:ofJoint <{client.part(robot, joint).url}> ; vom:numericalValue {value:.4f} ; "
        f"vom:unit unit:{'M' if joint in _IN_METRE else 'RAD'} ] ."
        for joint, value in targets.items()
    ]
    fields = TURTLE | {"prefer": "wait=30"}
    answer = client.http.post(
        of_robot(client, LF.MoveJoints, robot), content=PREFIXES + "\n".join(lines), headers=fields, timeout=40
    )
    assert answer.is_success, answer.text
