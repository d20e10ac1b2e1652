"""The process that renders (``eyes.py`` starts it): a robot once, then picture after picture, over stdin and stdout."""

import os
import select
import sys
from collections.abc import Callable
from functools import partial
from typing import BinaryIO

import msgspec

from linked_fleet_agent.robots.eyes import NOT, OK, Exposure, Scene, read_frame, write_frame

IDLE_S = 30.0
_NICENESS = 10  # the agent beside it is to move the robot on time


def main(task: str) -> None:
    """``probe``: say whether anything can be rendered, and end. ``serve``: until nothing was asked for IDLE_S."""
    os.nice(_NICENESS)
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever a library prints is no answer
    if task == "probe":
        _answer(answers, _probe)
    else:
        _serve(sys.stdin.buffer, answers)


def _serve(questions: BinaryIO, answers: BinaryIO) -> None:
    """The asking side waits for each answer, so nothing is read ahead of what ``select`` sees."""
    room = _Room()
    while select.select([questions], [], [], IDLE_S)[0]:
        try:
            question = read_frame(questions)
        except EOFError:
            return
        _answer(answers, partial(room.answer, question))


def _answer(to: BinaryIO, work: Callable[[], bytes]) -> None:
    """Send what comes of it, or why nothing does."""
    try:
        answer = OK + work()
    except Exception as error:  # noqa: BLE001 - the boundary of the process: OpenGL fails in ways of its own
        answer = NOT + (str(error) or type(error).__name__).splitlines()[0].encode()
    write_frame(to, answer)


def _probe() -> bytes:
    import mujoco

    mujoco.Renderer(mujoco.MjModel.from_xml_string("<mujoco/>"), 16, 16).close()
    return b""


class _Room:
    """Answer questions: the first one is the scene, each other one an exposure."""

    def __init__(self) -> None:
        self._take: Callable[[Exposure], bytes] | None = None

    def answer(self, question: bytes) -> bytes:
        if self._take is None:
            from linked_fleet_agent.robots.stage import Stage

            self._take = Stage(msgspec.msgpack.decode(question, type=Scene)).take
            return b""
        return self._take(msgspec.msgpack.decode(question, type=Exposure))


if __name__ == "__main__":
    main(sys.argv[1])
