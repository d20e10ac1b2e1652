"""A robot with cameras, played by the test: it answers requests for pictures as told."""

import itertools
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field

import zenoh
from msgspec.structs import replace

from fake_robots import KEYS, SIMPLE, FakeRobot
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.codec import PictureHeader, encode_picture
from linked_fleet_agent.wire.messages import Camera, Description, PictureQuery

PNG = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR" + struct.pack(">II", 4, 3) + bytes(5)
JPEG = b"\xff\xd8\xff\xc0\x00\x0b\x08" + struct.pack(">HH", 3, 4) + b"\x03"
DEPTH = struct.pack("<12f", *range(12))
EYE = Camera(
    name="eye", link="tip", width=4, height=3, vertical_fov_rad=1.0, near_m=0.1, far_m=9.0,
    formats=("jpeg", "png", "depth"),
)  # fmt: skip
BLIND = replace(EYE, formats=(), unavailable="nothing renders here")


@dataclass
class CameraRobot:
    """A robot played by the test: its answers, and the requests that it got."""

    actor: FakeRobot
    contents: dict[str, bytes] = field(default_factory=lambda: {"jpeg": JPEG, "png": PNG, "depth": DEPTH})
    asked: list[PictureQuery] = field(default_factory=list)
    payload: bytes | None = None
    sequence: Iterator[int] = field(default_factory=itertools.count)

    def appear(self, *cameras: Camera) -> "CameraRobot":
        said = codec.decode(self.actor.description(SIMPLE), Description)
        key = KEYS.robot(self.actor.name, "picture")
        self.actor.keep(self.actor.session.declare_queryable(key, lambda query: self._answer(key, query)))
        self.actor.appear(codec.encode(replace(said, cameras=cameras))).stand(0.5)
        return self

    def _answer(self, key: str, query: zenoh.Query) -> None:
        with query:
            assert query.payload is not None
            glance = codec.decode(query.payload.to_bytes(), PictureQuery)
            self.asked.append(glance)
            query.reply(key, self.payload or self.picture(glance))

    def picture(self, glance: PictureQuery) -> bytes:
        moment = PictureHeader(3, 4, self.actor.incarnation, next(self.sequence), 1, 1_700_000_000 * 10**9, 0.1, 9.0)
        return encode_picture(glance.format, moment, self.contents[glance.format])
