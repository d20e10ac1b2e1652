"""A short animation of the world for README.md: robots that move, seen by a camera that goes round them."""

from io import BytesIO
from pathlib import Path

from playwright.sync_api import Page

from browser import Browser as Client
from commanding import TURTLE, of_joint, slowly

FRAMES = 24
"""There and back: what is shown has twice as many, and no seam."""
SHOWN_MS = 100
WIDTH_PX = 800
_MOTIONS = (
    ("baxter", "right_s1", -0.9), ("baxter", "left_s0", 0.6), ("ur5", "shoulder_pan_joint", 1.4),
    ("panda", "panda_joint1", 1.2), ("tiago", "arm_2_joint", 0.8),
)  # fmt: skip
_TURN = """() => new Promise((resolve) => {
    const { view } = document.getElementById("scene").scene;
    Object.assign(view, { level: 0, slow: 0, untouched: false }); // as well as can be, however slow that is here
    view.turn(0.014, 0);
    requestAnimationFrame(() => requestAnimationFrame(resolve));
})"""


def animate(page: Page, client: Client, file: Path) -> None:
    """Write ``file``, an animated WebP, of the page of the fleet, whose scene is drawn."""
    from PIL import Image

    for robot, joint, angle in _MOTIONS:
        body = slowly(angle, speed=0.12)
        answer = client.http.post(of_joint(client, joint, robot=robot), content=body, headers=TURTLE)
        assert answer.is_success, answer.text
    shots = []
    for _ in range(FRAMES):
        page.evaluate(_TURN)
        shot = Image.open(BytesIO(page.locator("#scene").screenshot())).convert("RGB")
        shots.append(shot.resize((WIDTH_PX, round(shot.height * WIDTH_PX / shot.width)), Image.Resampling.LANCZOS))
    shown = [*shots, *shots[-2:0:-1]]
    shown[0].save(file, save_all=True, append_images=shown[1:], duration=SHOWN_MS, loop=0, quality=72, method=6)
