"""The cost of a message in each format: bytes, and the gateway's processor time from frame to body.

Measured in this process, without network: a robot of twenty joints that all move in each frame.
"""

import argparse
import math
import statistics
import struct
import time
from collections.abc import Callable, Iterator, Mapping

from bench.synthetic import robot, urdf
from bench.table import Row
from linked_fleet_agent.wire.codec import decode, layout
from linked_fleet_agent.wire.messages import Description
from linked_fleet_gateway.resources.binary_frames import FRAME_TYPES
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.tree import Tree
from linked_fleet_gateway.subscriptions.fan_out import FanOut
from linked_fleet_gateway.subscriptions.topic import Topic
from linked_fleet_identity.rights import ALL, View
from linked_fleet_rdf.serialise import JELLY
from linked_fleet_state.events import Appeared, Described, Framed
from linked_fleet_state.fleet import Fleet
from linked_fleet_state.invocations import Invocations

JOINTS, RUNS = 20, 5
_BASE = "http://127.0.0.1:8000"
_STATE = "the joint state of 20 joints"
_ROTATION = "one rotation"
_PATHS = {_STATE: "/arm/jointState", _ROTATION: "/arm/joint_0/rotation"}
_FORMS = {"Turtle": "text/turtle", "JSON-LD": "application/ld+json", "Jelly": JELLY, "binary frame": FRAME_TYPES[0]}


def rows(seconds: float) -> list[Row]:
    """Return bytes and processor time of each format, in about so many seconds; Turtle is the reference."""
    arm = _Arm()
    share_s = seconds / (len(_PATHS) * len(_FORMS) * RUNS)
    found = []
    for subject, path in _PATHS.items():
        topic = arm.topic(path)
        runs = [{name: _cost_us(arm, topic, form, share_s) for name, form in _FORMS.items()} for _ in range(RUNS)]
        us = {name: statistics.median(run[name] for run in runs) for name in _FORMS}
        size = {name: float(len(arm.message(topic, form))) for name, form in _FORMS.items()}
        found += _beside(f"message about {subject}", "B", size)
        found += _beside(f"message about {subject}", "us CPU", us)
    return found


def _beside(what: str, unit: str, figures: Mapping[str, float]) -> Iterator[Row]:
    turtle = figures["Turtle"]
    for name, value in figures.items():
        beside, ratio = ("", None) if name == "Turtle" else ("Turtle", value / turtle)
        yield Row(f"{what}, {name}, {unit}", unit, value, beside, ratio, "", None)


class _Arm:
    """A fleet of one robot with frames like those of an agent."""

    def __init__(self) -> None:
        said = robot("arm", JOINTS, urdf(JOINTS))
        self._frame, self._sequence = said.frame, 0
        self._fields = {field.name: field.offset for field in layout(JOINTS, False)}
        self._fleet = Fleet()
        self._fleet.apply(Appeared("arm", said.run), 1)
        self._fleet.apply(Described(decode(said.description, Description)), 1)
        self.move()

    def topic(self, path: str) -> Topic:
        found = self._tree(_BASE, ALL).resolve(path)
        assert isinstance(found, Resource)
        return Topic(FanOut(self._tree), path, True, found)

    def message(self, topic: Topic, media_type: str) -> bytes:
        """Return the message after a frame, read and rendered as in the fan-out."""
        self.move()
        topic.refresh(after_frame=True)
        return topic.message(media_type, _BASE).body

    def move(self) -> None:
        """Apply a frame with another position, velocity and effort of each joint."""
        self._sequence += 1
        values = [math.sin(self._sequence + number) for number in range(3 * JOINTS)]
        struct.pack_into("<Q", self._frame, self._fields["sequence"], self._sequence)
        struct.pack_into(f"<{len(values)}d", self._frame, self._fields["positions"], *values)
        self._fleet.apply(Framed("arm", bytes(self._frame)), 1)

    def _tree(self, base: str, sees: View) -> Tree:
        return Tree(self._fleet, Invocations(), base, visible_robots=sees)


def _cost_us(arm: _Arm, topic: Topic, media_type: str, seconds: float) -> float:
    """Return the processor time from frame to body: decoding, comparing, writing."""

    def message() -> None:
        arm.message(topic, media_type)

    message()
    return _us(message, seconds)


def _us(call: Callable[[], None], seconds: float) -> float:
    count, end, begin = 0, time.perf_counter() + seconds, time.process_time()
    while count == 0 or time.perf_counter() < end:
        call()
        count += 1
    return (time.process_time() - begin) / count * 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10)
    for row in rows(parser.parse_args().seconds):
        ratio = "" if row.ratio is None else f"{row.ratio:.3f} of {row.reference}"
        print(f"{row.name:66}{row.value:12,.1f} {ratio}")


if __name__ == "__main__":
    main()
