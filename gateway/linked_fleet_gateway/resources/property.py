"""One property of one thing (paper 5.2), whatever it is about."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import NamedTuple, Self

from pyoxigraph import NamedNode

from linked_fleet_gateway.base.contributed import Contributed
from linked_fleet_gateway.fleet.observation import Observation
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.rdf.graph import Graph
from linked_fleet_gateway.resources.action_offer import Offer
from linked_fleet_gateway.resources.setting import Setting


class Seen(NamedTuple):
    """Measured values, NaN where they are unknown, and the time of the latest frame that moved one of them."""

    values: tuple[float, ...] = ()
    wall_ns: int | None = None
    outside: tuple[bool, ...] = ()
    """Return for each observation True if it is a position outside its limits."""

    @classmethod
    def of(cls, observations: Sequence[Observation]) -> Self:
        if len(observations) == 1:
            return cls(observations[0].values, observations[0].wall_ns, (observations[0].outside,))
        stamps = [each.wall_ns for each in observations if each.wall_ns is not None]
        values = tuple(chain.from_iterable(each.values for each in observations))
        return cls(values, max(stamps, default=None), tuple([each.outside for each in observations]))


Describe = Callable[[Graph, NamedNode, Seen], None]
Look = Callable[[], tuple[Observation, ...]]


@dataclass(frozen=True)
class Property:
    """One property of one thing; ``describe`` adds what is special to it, with the values that it is given.

    ``look`` observes what is measured: it alone makes a new frame news, and ``describe`` shows it as it is, so that a
    description of other values is the same one with other numbers. ``facts`` gives what else is news. ``put``: what
    clients may replace it by, the setting or the action of a motion.
    """

    segment: str
    predicate: NamedNode
    types: tuple[NamedNode, ...]
    shape: NamedNode
    title: str
    describe: Describe
    look: Look = tuple
    facts: Callable[[], object] = tuple
    put: Setting | Offer | None = None

    @property
    def measured(self) -> bool:
        return self.look is not tuple


ROBOT_PROPERTIES = Contributed[Callable[[Robot], Property]]()
"""Makers of further properties of robots."""
