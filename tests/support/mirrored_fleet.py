"""A fleet and its mirror in the query process, without network or clock."""

import math
from collections.abc import Sequence

from fake_robots import joint, link, robot
from linked_fleet_agent.wire.codec import encode_state, layout
from linked_fleet_agent.wire.messages import Base, State
from linked_fleet_gateway.extensions.query.fleet_mirror import Mirror
from linked_fleet_gateway.extensions.query.messages import News, QueryRequest, decode_ask, encode
from linked_fleet_gateway.extensions.query.process import Feed
from linked_fleet_state.answers import DescriptionAndComponents
from linked_fleet_state.events import Appeared, Described, Framed, Vanished
from linked_fleet_state.fleet import Fleet
from linked_fleet_state.invocations import Invocations

URDF = robot(
    link("base"), link("arm"), link("hand", inertial=False), link("tip"),
    joint("elbow", "revolute", "base", "arm"), joint("slide", "prismatic", "arm", "hand"),
    joint("grip", "fixed", "hand", "tip"),
)  # fmt: skip
JOINTS = ("elbow", "slide")


class MirroredFleet:
    """``bring`` updates the mirror from the fleet, with the message that goes from one process to the other."""

    def __init__(self, fleet: Fleet | None = None, invocations: Invocations | None = None) -> None:
        self.fleet, self.invocations, self.mirror = fleet or Fleet(), invocations or Invocations(), Mirror()
        self._feed = Feed(self.fleet, self.invocations, lambda robot, path: [])
        self._sequence = 0

    def describe(
        self, name: str, run: int = 1, *, floating: bool = False, annotations: str = "", components: bytes = b"[]"
    ) -> None:
        said = DescriptionAndComponents(
            version=1, robot=name, incarnation=run, title=f"The {name}", urdf=URDF, joints=JOINTS, rate_hz=100,
            base="floating" if floating else "fixed", capabilities=("move", "stop"), annotations=annotations,
            layout=layout(len(JOINTS), floating), components=components,
        )  # fmt: skip
        self.fleet.apply(Appeared(name, run), 1)
        self.fleet.apply(Described(said), 1)

    def stand(self, name: str, positions: Sequence[float], run: int = 1, base: Base | None = None) -> None:
        self._sequence += 1
        state = State(
            incarnation=run, sequence=self._sequence, monotonic_ns=1, wall_ns=self._sequence * 10**9,
            positions=tuple(positions), velocities=(0.5, math.nan), efforts=(1.0, 2.0), base=base,
        )  # fmt: skip
        self.fleet.apply(Framed(name, encode_state(state)), 1)

    def leave(self, name: str, run: int = 1) -> None:
        self.fleet.apply(Vanished(name, run), 2)

    def news(self) -> News:
        """Return what the next query sends."""
        return self._feed.news()

    def bring(self) -> Mirror:
        ask = QueryRequest(
            news=self.news(), query="", base="", base_iri="", patterns=("*",), caller="", default=None,
            named=None, branches=[], invocations=self._feed.fleet_invocations(), graphs=[], media_type="",
            most_bytes=1, limit_s=1.0,
        )  # fmt: skip
        self.mirror.update(decode_ask(encode(ask)).news)
        return self.mirror
