"""Drives a base with a phone, whose web app is that of the package teleop.

Run ``python examples/phone.py http://127.0.0.1:8000/tiago/mobile_base/actions/drive``, and open the address that it
prints on a phone. While its button is held, moving the phone ahead drives ahead, and turning it turns.
"""

import argparse
import asyncio
import json
import math
import threading
import time
from typing import Any

from teleop import Teleop  # type: ignore[import-not-found]
from websockets.asyncio.client import connect

REACH_M, REACH_RAD = 0.2, 0.8
"""How far the phone is moved and turned for the full speed."""
SPEED_M_S, TURN_RAD_S = 0.5, 0.8
SILENCE_S = 0.2
"""A phone that has said nothing for longer does not drive."""


class Phone:
    """Keeps what the phone has said last."""

    def __init__(self) -> None:
        self.velocity, self.said_s = (0.0, 0.0), -math.inf
        self._began: Any = None

    def hear(self, pose: Any, message: dict[str, Any]) -> None:
        """Take a pose, a matrix (4, 4) with x ahead and z up, and whether the button is held."""
        self.said_s = time.monotonic()
        if not message["move"]:
            self._began, self.velocity = None, (0.0, 0.0)
            return
        self._began = pose.copy() if self._began is None else self._began
        turn = math.atan2(pose[1, 0], pose[0, 0]) - math.atan2(self._began[1, 0], self._began[0, 0])
        ahead_m, turn = pose[0, 3] - self._began[0, 3], math.remainder(turn, math.tau)
        self.velocity = SPEED_M_S * _share(ahead_m / REACH_M), TURN_RAD_S * _share(turn / REACH_RAD)

    @property
    def wanted(self) -> dict[str, float]:
        linear, angular = self.velocity if time.monotonic() - self.said_s < SILENCE_S else (0.0, 0.0)
        return {"linear": linear, "angular": angular}


def _share(value: float) -> float:
    return float(min(max(value, -1.0), 1.0))


async def drive(action: str, phone: Phone) -> None:
    """Send what the phone wants whenever the robot has told something, until the robot ends it."""
    async with connect(action.replace("http", "ws", 1), subprotocols=["lf.drive"]) as robot:  # type: ignore[list-item]
        async for message in robot:
            told = json.loads(message)
            if told.get("ended"):
                print(told["reason"])
            elif told["time"] is not None:
                await robot.send(json.dumps({"seen": told["time"], "input": phone.wanted}))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("action", help="the address of the action drive of a base")
    parser.add_argument("--host", default="0.0.0.0", help="where the web app is served")  # noqa: S104 - to the phone
    parser.add_argument("--port", type=int, default=4443)
    asked = parser.parse_args()
    phone, app = Phone(), Teleop(host=asked.host, port=asked.port)
    app.subscribe(phone.hear)
    threading.Thread(target=app.run, daemon=True).start()
    asyncio.run(drive(asked.action, phone))


if __name__ == "__main__":
    main()
