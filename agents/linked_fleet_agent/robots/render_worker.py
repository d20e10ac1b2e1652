"""The render process that ``camera_client.py`` starts. It reads a scene and picture requests from stdin."""

import os
import select
import sys
from collections.abc import Callable
from functools import partial
from typing import BinaryIO

import msgspec

from linked_fleet_agent.robots.camera_client import NOT, OK, PictureRequest, Scene, read_frame, write_frame

IDLE_S = 30.0
_NICENESS = 10  # lets the agent beside it move the robot on time


def main(task: str) -> None:
    """Run ``probe`` (report if rendering works, and exit) or ``serve`` (render until no request came for IDLE_S)."""
    os.nice(_NICENESS)
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # output of libraries must not mix with the answers
    if task == "probe":
        _answer(answers, _probe)
    else:
        _serve(sys.stdin.buffer, answers)


def _serve(questions: BinaryIO, answers: BinaryIO) -> None:
    """Answer requests. The client waits for each answer, so nothing is buffered beyond what ``select`` sees."""
    room = _Worker()
    while select.select([questions], [], [], IDLE_S)[0]:
        try:
            question = read_frame(questions)
        except EOFError:
            return
        _answer(answers, partial(room.answer, question))


def _answer(to: BinaryIO, work: Callable[[], bytes]) -> None:
    """Send the result of ``work``, or its error."""
    try:
        answer = OK + work()
    except Exception as error:  # noqa: BLE001 - the boundary of the process: OpenGL raises errors of its own
        answer = NOT + (str(error) or type(error).__name__).splitlines()[0].encode()
    write_frame(to, answer)


def _probe() -> bytes:
    import mujoco

    mujoco.Renderer(mujoco.MjModel.from_xml_string("<mujoco/>"), 16, 16).close()
    return b""


class _Worker:
    """Answers requests: the first one sets the scene, each later one asks for a picture."""

    def __init__(self) -> None:
        self._take: Callable[[PictureRequest], bytes] | None = None

    def answer(self, question: bytes) -> bytes:
        if self._take is None:
            from linked_fleet_agent.robots.camera_scene import CameraScene

            self._take = CameraScene(msgspec.msgpack.decode(question, type=Scene)).take
            return b""
        return self._take(msgspec.msgpack.decode(question, type=PictureRequest))


if __name__ == "__main__":
    main(sys.argv[1])
