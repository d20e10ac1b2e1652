"""Orders: what a client wants to be run, and what has become of it. Pure values, whose JSON is that of the store."""

from typing import Annotated, Literal

from msgspec import Meta, Struct
from msgspec.structs import replace

from linked_fleet_gateway.extensions.missions.mission import Name
from linked_fleet_gateway.extensions.missions.record import Creator

MOST_CANDIDATES = 200
HIGHEST = 100
"""The highest priority; the lowest is its negative."""
State = Literal["waiting", "starting", "running", "succeeded", "failed", "cancelled", "missed"]
OVER: frozenset[State] = frozenset({"succeeded", "failed", "cancelled", "missed"})
_NOTES = 8
"""Notes of an order that are kept, the latest."""

Iri = Annotated[str, Meta(max_length=2048)]
Coordinate = Annotated[float, Meta(ge=-1_000_000, le=1_000_000)]
Values = dict[Name, bool | int | float | Annotated[str, Meta(max_length=2048)]]


class Point(Struct, frozen=True, forbid_unknown_fields=True):
    """A point on the floor of the world, in metre."""

    x: Coordinate
    y: Coordinate


class Choice(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Any robot that can: which robots may be the value of a parameter. What is given must all be true of a robot.

    ``robots`` are their IRIs, ``kind`` is the class of a component that they have, ``offers`` the kind of an action
    that they, or parts of them, offer. ``select`` is a SPARQL SELECT whose first variable is bound to them. Of the free
    ones the nearest to ``near`` is taken.
    """

    parameter: Name
    robots: Annotated[tuple[Iri, ...], Meta(max_length=MOST_CANDIDATES)] = ()
    kind: Iri = ""
    offers: Iri = ""
    select: Annotated[str, Meta(max_length=4096)] = ""
    near: Point | None = None


class Wanted(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The statements of a client. ``input`` are values of the parameters of the ``mission``, an IRI.

    ``battery`` is the charge in percent that each of its robots has to have at the start. ``deadline`` is the
    xsd:dateTime until which it may begin.
    """

    mission: Iri
    title: Annotated[str, Meta(max_length=200)] = ""
    input: Annotated[Values, Meta(max_length=32)] = {}
    choice: Choice | None = None
    battery: Annotated[float, Meta(ge=0, le=100)] = 0.0
    priority: Annotated[int, Meta(ge=-HIGHEST, le=HIGHEST)] = 0
    deadline: Annotated[str, Meta(max_length=40)] = ""


class Order(Struct, frozen=True, omit_defaults=True):
    """An order. ``rank`` is its place among those of its priority. Times in wall nanoseconds, 0 if there is none.

    ``base`` begins the IRIs of its client. ``run`` is the id of the run. ``robots`` are reserved for it while it is
    starting or running, ``chosen`` is the one that was chosen. ``cancelling`` and ``returning`` say why its run is
    being cancelled: it is over then, or goes back to the queue.
    """

    wanted: Wanted
    base: str = ""
    mission_path: str = ""
    title: str = ""
    creator: Creator = Creator()
    created_ns: int = 0
    rank: float = 0.0
    state: State = "waiting"
    reason: str = ""
    attempt: int = 0
    robots: tuple[str, ...] = ()
    chosen: str = ""
    run: str = ""
    began_ns: int = 0
    ended_ns: int = 0
    cancelling: str = ""
    returning: str = ""
    schedule: str = ""
    notes: tuple[str, ...] = ()

    @property
    def client(self) -> str:
        """The name by which its client's orders are counted."""
        return self.creator.identity or self.creator.client

    @property
    def is_over(self) -> bool:
        return self.state in OVER


class Assignment(Struct, frozen=True):
    """The robots that an attempt of an order has, and the run of the gateway that has given them."""

    attempt: int
    robots: tuple[str, ...]
    chosen: str
    owner: str


class Assignments(Struct, frozen=True):
    """All robots that orders have, by order: one record, so that one write gives all robots of an order, or none."""

    orders: dict[str, Assignment] = {}

    @property
    def busy(self) -> dict[str, str]:
        """The order that has a robot, by robot."""
        return {robot: id for id, each in self.orders.items() for robot in each.robots}


def begun(order: Order, given: Assignment, now_ns: int) -> Order:
    """Return a waiting order once it has its robots."""
    return replace(
        order, state="starting", reason="", attempt=given.attempt, robots=given.robots, chosen=given.chosen,
        run="", began_ns=now_ns, ended_ns=0,
    )  # fmt: skip


def ended(order: Order, state: State, reason: str, now_ns: int) -> Order:
    """Return an order that is over."""
    return replace(order, state=state, reason=reason, ended_ns=now_ns, cancelling="", returning="")


def returned(order: Order, rank: float) -> Order:
    """Return an order that goes back to the queue, with a note why."""
    notes = (*order.notes, f"attempt {order.attempt}: {order.returning}")[-_NOTES:]
    return replace(
        order, state="waiting", reason="", rank=rank, robots=(), chosen="", run="", began_ns=0, returning="",
        notes=notes,
    )  # fmt: skip
