"""One property of one thing (paper 5.2), whatever it is about."""

from collections.abc import Callable
from dataclasses import dataclass

from pyoxigraph import NamedNode

from gateway.actions.offer import Offer
from gateway.fleet.observation import Observation
from gateway.graph.build import Graph
from gateway.graph.setting import Setting

Describe = Callable[[Graph, NamedNode], None]
Look = Callable[[], tuple[Observation, ...]]


@dataclass(frozen=True)
class Property:
    """One property of one thing; ``describe`` adds what is special to it, with the present value.

    ``look`` gives the measured values that ``describe`` shows: they alone make a new frame news. ``facts`` gives what
    else is news of it. ``put``: what clients may replace it by, the setting or the action of a motion.
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
