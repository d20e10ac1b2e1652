"""Robots for one test, described and with a frame, and requests to them, without network or clock."""

import itertools
from collections.abc import Mapping, Sequence

import pytest

from fake_robots import link, robot
from linked_fleet_agent.wire.codec import encode_state, layout
from linked_fleet_agent.wire.messages import Description, State
from linked_fleet_base.contributions import set_present
from linked_fleet_gateway.actions.action_handlers import HANDLERS, Plan
from linked_fleet_gateway.actions.admission import validate_action_body
from linked_fleet_gateway.actions.plan import ActionRequest, robot_time
from linked_fleet_gateway.app.extensions import BUILT_IN, contributions_of
from linked_fleet_gateway.extensions.reach.can_reach import LF
from linked_fleet_gateway.extensions.reach.extension import reach
from linked_fleet_gateway.resources.action_offer import Offer
from linked_fleet_gateway.resources.affordance import Invoke
from linked_fleet_gateway.resources.body_values import Body
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.tree import Tree
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.serialise import parse
from linked_fleet_rdf.vocabulary import PREFIXES
from linked_fleet_state.events import Appeared, Described, Framed
from linked_fleet_state.fleet import Fleet
from linked_fleet_state.invocations import Invocations
from linked_fleet_state.robot import Robot

EVERY_EXTENSION = contributions_of(BUILT_IN)
set_present(EVERY_EXTENSION)  # test cases are generated during collection


@pytest.fixture(autouse=True)
def every_extension() -> None:
    """Have all extensions present, since another test may have set others."""
    set_present(EVERY_EXTENSION)


_PREFIXES = "".join(f"@prefix {prefix}: <{iri}> .\n" for prefix, iri in PREFIXES.items())


class Bench:
    """Joints are (kind, contents of the URDF element), by name, each below the one before."""

    base = "http://example.org"

    def __init__(self) -> None:
        self.fleet = Fleet()
        self._runs = itertools.count(1)

    def robot(
        self,
        joints: Mapping[str, tuple[str, str]],
        positions: Sequence[float] | None = (),
        *,
        name: str = "r",
        listed: Sequence[str] | None = None,
        capabilities: tuple[str, ...] = ("move", "follow", "stop"),
        annotations: str = "",
    ) -> Robot:
        """Add a run of an agent, with a frame unless ``positions`` is None; missing positions are zero."""
        parents = ["base", *(f"{each}_link" for each in joints)]
        elements = [
            f'<joint name="{each}" type="{kind}"><parent link="{parent}"/><child link="{each}_link"/>'
            f'<axis xyz="0 0 1"/>{inner}</joint>'
            for parent, (each, (kind, inner)) in zip(parents, joints.items(), strict=False)
        ]
        movable = [each for each, (kind, _) in joints.items() if kind in ("revolute", "continuous", "prismatic")]
        names = tuple(movable if listed is None else listed)
        run = next(self._runs)
        description = Description(
            version=1,
            robot=name,
            incarnation=run,
            title=name,
            urdf=robot(*map(link, parents), *elements),
            joints=names,
            rate_hz=100,
            capabilities=capabilities,
            annotations=self.prefixed(annotations),
            layout=layout(len(names), False),
        )
        self.fleet.apply(Appeared(name, run), 1)
        self.fleet.apply(Described(description), 1)
        if positions is not None:
            padded = (*positions, *(0.0 for _ in names))[: len(names)]
            self.stand(name, run, padded)
        return self.fleet.robots[name]

    def stand(self, name: str, run: int, positions: Sequence[float]) -> None:
        zeros = (0.0,) * len(positions)
        state = State(
            incarnation=run,
            sequence=self.fleet.robots[name].last_sequence() + 1,
            monotonic_ns=1,
            wall_ns=1,
            positions=tuple(positions),
            velocities=zeros,
            efforts=zeros,
        )
        self.fleet.apply(Framed(name, encode_state(state)), 1)

    def resource(self, path: str) -> Resource | None:
        found = Tree(self.fleet, Invocations(), self.base).resolve(path)
        assert found is None or isinstance(found, Resource)
        return found

    def described(self, path: str) -> Graph:
        found, graph = self.resource(path), Graph()
        assert found is not None, path
        assert found.describe is not None
        found.describe(graph)
        return graph

    def offer(self, path: str) -> Offer:
        found = self.resource(path)
        assert found is not None, path
        assert isinstance(found.affords, Invoke)
        return found.affords.offer

    def body(self, path: str, turtle: str) -> Body:
        """Return the admitted body of the action at ``path``."""
        triples = parse(self.prefixed(turtle).encode(), "text/turtle", self.base + path)
        return validate_action_body(self.offer(path), triples, self.base)

    def plan(self, path: str, turtle: str = "") -> Plan:
        offer = self.offer(path)
        body = self.body(path, turtle) if offer.takes_body else Body((), offer.definition.iri)
        request = ActionRequest(self.base, body, offer.robot, offer.joint, robot_time(offer.robot))
        return {**HANDLERS, LF.Reach: reach}[offer.definition.iri](request)

    @staticmethod
    def prefixed(turtle: str) -> str:
        return _PREFIXES + turtle


@pytest.fixture
def bench() -> Bench:
    return Bench()
