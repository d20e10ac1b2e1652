"""The cameras of a simulated robot, rendered in a process of its own so that rendering cannot disturb the control loop.

The process starts with the first picture request and ends after a period without requests. It gets its OpenGL backend
from the environment, because MuJoCo reads that only once, at import.
"""

import logging
import os
import struct
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache, cached_property
from pathlib import Path
from typing import IO, Literal

import msgspec

import linked_fleet_agent
from linked_fleet_agent.robot import PictureError, Reading
from linked_fleet_agent.wire.messages import Camera, PictureFormat

_log = logging.getLogger(__name__)

FORMATS: tuple[PictureFormat, ...] = ("jpeg", "png", "depth")
_OFF = ("disable", "disabled", "off", "false", "0")
_TIMEOUT_S = 20.0  # long enough for the first picture on a busy machine, which loads the meshes
_SIZE = struct.Struct("<I")
OK, NOT = b"\0", b"\1"


class Scene(msgspec.Struct, frozen=True, kw_only=True):
    """The scene to render: the robot of a URDF at path ``file``; ``home`` is by joint, in rad or m."""

    robot: str
    urdf: str
    file: str
    floating: bool
    home: Mapping[str, float]
    cameras: Sequence[Camera]


class PictureRequest(msgspec.Struct, frozen=True, kw_only=True):
    """One picture: positions by joint, and the position and quaternion x y z w of a floating base in the world."""

    camera: str
    format: PictureFormat
    positions: Mapping[str, float]
    base: tuple[float, ...] | None


def write_frame(to: IO[bytes], content: bytes) -> None:
    """Write one frame. Raises OSError (BrokenPipeError) if the other end is closed."""
    to.write(_SIZE.pack(len(content)))
    to.write(content)
    to.flush()


def read_frame(source: IO[bytes]) -> bytes:
    """Read one frame. Raises EOFError if the other end is closed."""
    head = source.read(_SIZE.size)
    content = source.read(_SIZE.unpack(head)[0]) if len(head) == _SIZE.size else b""
    if not content:
        raise EOFError("the other end is closed")
    return content


class Probe:
    """Finds an OpenGL backend that can render here; the test runs in the background."""

    def __init__(self, asked: str | None) -> None:
        self._ways = ("egl", "osmesa") if not asked else (asked,)
        self._off = asked is not None and asked.lower() in _OFF
        self._first = None if self._off else _Renderer(self._ways[0], "probe")

    @cached_property
    def result(self) -> tuple[str, str]:
        """The backend and the reason for having none; one of them is empty."""
        if self._first is None:
            return "", "rendering is switched off here (MUJOCO_GL)"
        reasons = []
        for way in self._ways:
            renderer = self._first if way == self._ways[0] else _Renderer(way, "probe")
            try:
                renderer.ready()
                return way, ""
            except PictureError as error:
                reasons.append(f"{way}: {error}")
            finally:
                renderer.close()
        return "", f"nothing renders here: {'; '.join(reasons)}"[:512]


@cache
def probe() -> Probe:
    """Return the one probe of this process, which starts with the first call."""
    return Probe(os.environ.get("MUJOCO_GL"))


def with_availability(cameras: Sequence[Camera], reason: str) -> tuple[Camera, ...]:
    """Return the cameras with the available formats, or with the ``reason`` for having none."""
    formats = () if reason else FORMATS
    return tuple(msgspec.structs.replace(camera, formats=formats, unavailable=reason) for camera in cameras)


class Renderer:
    """Renders the cameras of one robot, from one thread at a time; ``close`` may be called from any thread."""

    def __init__(self, scene: Scene, way: str) -> None:
        self._scene, self._way = scene, way
        self._renderer: _Renderer | None = None
        self._closed = False

    def take(self, camera: str, format: PictureFormat, reading: Reading, joints: Sequence[str]) -> bytes:
        """Return one picture. Raises PictureError if the renderer fails or does not answer in time."""
        base = None if reading.base is None else (*reading.base.position_m, *reading.base.orientation_xyzw)
        positions = dict(zip(joints, reading.positions, strict=True))
        order = msgspec.msgpack.encode(PictureRequest(camera=camera, format=format, positions=positions, base=base))
        for _ in range(2):
            if self._closed:
                raise PictureError("the robot is closed")
            try:
                return self._ready().ask(order)
            except EOFError:  # it had just ended for lack of requests
                self._end()
        raise PictureError("the render process keeps ending")

    def _ready(self) -> "_Renderer":
        renderer = self._renderer
        if renderer is None or renderer.ended:
            self._end()
            renderer = self._renderer = _Renderer(self._way, "serve")
            try:
                renderer.ask(msgspec.msgpack.encode(self._scene))
            except PictureError:
                self._end()
                raise
        return renderer

    def close(self) -> None:
        """End the process for good: none is started for a picture that is being taken."""
        self._closed = True
        self._end()

    def _end(self) -> None:
        if (renderer := self._renderer) is not None:
            self._renderer = None
            renderer.close()


class _Renderer:
    """A process of ``render_worker.py``."""

    def __init__(self, way: str, task: Literal["probe", "serve"]) -> None:
        path = os.pathsep.join([str(Path(linked_fleet_agent.__file__).parent.parent), os.environ.get("PYTHONPATH", "")])
        # One thread: rendering must leave the other processors to the control loop.
        environment = {**os.environ, "MUJOCO_GL": way, "PYTHONPATH": path, "LP_NUM_THREADS": "1"}
        self._process = subprocess.Popen(  # noqa: S603 - this program
            [sys.executable, "-m", "linked_fleet_agent.robots.render_worker", task],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=environment,
            start_new_session=True,  # Ctrl-C goes to the agent, whose end closes this process
        )

    @property
    def ended(self) -> bool:
        return self._process.poll() is not None

    def ready(self) -> None:
        """Wait until it can render. Raises PictureError."""
        try:
            self._exchange(None)
        except EOFError:
            raise PictureError(f"the render process ended with {self._process.wait()}") from None

    def ask(self, question: bytes) -> bytes:
        """Return the answer. Raises PictureError with the reported error, EOFError if the process has ended."""
        return self._exchange(question)

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            with suppress(BrokenPipeError):
                pipe.close()

    def _exchange(self, question: bytes | None) -> bytes:
        to, source = self._process.stdin, self._process.stdout
        assert to is not None and source is not None
        late = threading.Event()

        def give_up() -> None:
            late.set()
            self._process.kill()

        watchdog = threading.Timer(_TIMEOUT_S, give_up)
        watchdog.start()
        try:
            if question is not None:
                write_frame(to, question)
            answer = read_frame(source)
        except (EOFError, BrokenPipeError) as error:
            if late.is_set():
                raise PictureError(f"nothing was rendered within {_TIMEOUT_S:g} s") from error
            raise EOFError from error
        finally:
            watchdog.cancel()
        if answer[:1] != OK:
            raise PictureError(answer[1:].decode("utf-8", "replace")[:512])
        return answer[1:]
