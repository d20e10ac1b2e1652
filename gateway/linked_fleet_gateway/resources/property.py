"""One property of one thing (paper 5.2), and what extensions add to robots and links."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain
from typing import NamedTuple, Self

from msgspec import Struct
from pyoxigraph import Literal, NamedNode

from linked_fleet_base.contributions import present
from linked_fleet_gateway.resources.action_offer import Offer
from linked_fleet_gateway.resources.body_values import Setting
from linked_fleet_gateway.resources.form import Form
from linked_fleet_rdf.graph import Graph, Number
from linked_fleet_state.model import Link
from linked_fleet_state.observation import Mark, Observation
from linked_fleet_state.robot import Robot


class Measurement(NamedTuple):
    """Measured values (NaN if unknown) and the time of the latest frame that changed one of them.

    A template is made of literals in place of known values and times (``resources/description.py``).
    """

    values: tuple[Number, ...] = ()
    wall_ns: int | Literal | None = None
    marks: tuple[Mark, ...] = ()
    """The mark of each observation."""

    @classmethod
    def from_observations(cls, observations: Sequence[Observation]) -> Self:
        if len(observations) == 1:
            return cls(observations[0].values, observations[0].wall_ns, (observations[0].mark,))
        stamps = [each.wall_ns for each in observations if each.wall_ns is not None]
        values = tuple(chain.from_iterable(each.values for each in observations))
        return cls(values, max(stamps, default=None), tuple([each.mark for each in observations]))


Describe = Callable[[Graph, NamedNode, Measurement], None]
Sampler = Callable[[], tuple[Observation, ...]]


class Property(Struct, frozen=True):
    """One property of a thing; ``describe`` adds its specific statements for given values.

    ``sample`` observes measured values. Only it makes a new frame a change, and ``describe`` depends on its values
    only, which it passes to ``Graph.scalar``, ``vector``, ``quaternion`` and ``result_time``. ``facts`` returns
    everything else that counts as a change. ``put`` is the setting or the action behind PUT.
    """

    segment: str
    predicate: NamedNode
    types: tuple[NamedNode, ...]
    shape: NamedNode
    title: str
    describe: Describe
    sample: Sampler = tuple
    facts: Callable[[], object] = tuple
    put: Setting | Offer | None = None
    counter: Callable[[], int] | None = None
    """As in ``Source``."""
    form: Form | None = None
    """Its JSON form, if that is not the form of ``shape``."""
    json: Callable[[], bytes] | None = None
    """Returns its JSON document, likewise."""
    describe_shapes: Callable[[Graph], None] | None = None
    """Adds the shape, and that of the body of PUT, if they are not in blueprints."""

    steps: Callable[[Graph, NamedNode], Iterator[None]] | None = None
    """Adds what ``describe`` adds, in steps."""
    is_long: Callable[[], bool] = bool
    """Returns True if ``describe`` takes more than a few milliseconds at present; there are ``steps`` then."""

    @property
    def is_measured(self) -> bool:
        return self.sample is not tuple

    @property
    def inputs(self) -> tuple[NamedNode, ...]:
        """Further shapes of its blueprint, if it describes them itself."""
        return () if self.describe_shapes is None or self.put is None else (input_shape(self.shape),)


def input_shape(shape: NamedNode) -> NamedNode:
    """Return the shape of a body of PUT beside the shape of a property."""
    return NamedNode(shape.value.partition("#")[0] + "#input")


def added_robot_properties() -> Sequence[Callable[[Robot], Property]]:
    """Return the functions from a robot to a property that extensions add."""
    return present().robot_properties


def added_introductions() -> Sequence[Callable[[Robot], Iterable[tuple[NamedNode, Literal]]]]:
    """Return the functions from a robot to what extensions add where the fleet lists it."""
    return present().introductions


def added_link_statements() -> Sequence[Callable[[Robot, Link], Iterable[tuple[NamedNode, str]]]]:
    """Return the functions from a robot and a link to predicates and paths that extensions add."""
    return present().link_statements
