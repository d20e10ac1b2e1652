"""Whose turn it is, by priority, client and place, and which robots an order gets. Pure."""

import itertools
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any, cast

import pytest
from msgspec.structs import replace

from linked_fleet_gateway.api import Conflict, Robot
from linked_fleet_gateway.extensions.latches.extension import Latches
from linked_fleet_gateway.extensions.latches.latch import Latch
from linked_fleet_gateway.extensions.missions.record import Creator
from linked_fleet_gateway.extensions.queue.order import Choice, Order, Point, Wanted
from linked_fleet_gateway.extensions.queue.ranks import (
    in_turn,
    passed,
    rank_beside,
    rank_of_first,
    rank_of_new,
)
from linked_fleet_gateway.extensions.queue.robots import Abilities, Robots
from linked_fleet_gateway.extensions.queue.turns import Need, decide
from linked_fleet_state.model import Pose

UPRIGHT = (0.0, 0.0, 0.0, 1.0)


class Queue:
    """Orders as clients add them."""

    def __init__(self) -> None:
        self.orders: dict[str, Order] = {}
        self._numbers = itertools.count(1)

    def add(self, client: str, priority: int = 0) -> str:
        id = f"{client}{next(self._numbers)}"
        rank = rank_of_new(self.orders.values(), client, priority)
        wanted = Wanted("http://a/missions/m", priority=priority)
        created = len(self.orders)
        self.orders[id] = Order(wanted, creator=Creator(client), rank=rank, created_ns=created)
        return id

    def row(self) -> list[str]:
        return [id for id, _ in in_turn(self.orders)]

    def take(self, state: Any = "running") -> str:
        id = self.row()[0]
        self.orders[id] = replace(self.orders[id], state=state)
        return id

    def move(self, id: str, other: str, *, before: bool = True) -> None:
        self.orders[id] = replace(self.orders[id], rank=rank_beside(self.orders, id, other, before=before))


def test_a_higher_priority_comes_first_and_else_the_earlier_order() -> None:
    queue = Queue()
    first, second, urgent = queue.add("a"), queue.add("a"), queue.add("a", 5)
    assert queue.row() == [urgent, first, second]


def test_clients_take_turns_however_many_orders_one_of_them_has() -> None:
    queue = Queue()
    many = [queue.add("a") for _ in range(100)]
    few = [queue.add("b") for _ in range(2)]
    assert queue.row()[:5] == [many[0], few[0], many[1], few[1], many[2]]


def test_a_client_that_adds_one_order_at_a_time_does_not_have_every_turn() -> None:
    queue = Queue()
    many = {queue.add("a") for _ in range(10)}
    taken = []
    for _ in range(10):
        queue.add("b")
        taken.append(queue.take("succeeded"))
    assert 4 <= len(many.intersection(taken)) <= 6


def test_an_order_is_moved_beside_another_and_stays_there() -> None:
    queue = Queue()
    a, b, c, d = (queue.add("a") for _ in range(4))
    queue.move(d, a)
    assert queue.row() == [d, a, b, c]
    queue.move(d, b)
    assert queue.row() == [a, d, b, c]
    queue.move(a, c, before=False)
    assert queue.row() == [d, b, c, a]
    queue.move(c, b)
    assert queue.row() == [d, c, b, a]
    assert queue.add("a") == queue.row()[-1]


def test_orders_of_several_clients_can_be_moved_between_each_other() -> None:
    queue = Queue()
    row = [queue.add(client) for client in "abcd"]
    last = queue.add("e")
    queue.move(last, row[2])
    assert queue.row() == [*row[:2], last, *row[2:]]
    assert passed(queue.orders, last, rank_beside(queue.orders, last, row[1], before=True)) == {"b"}


def test_a_place_without_room_is_refused_with_a_sentence() -> None:
    queue = Queue()
    a, b, c = (queue.add("a") for _ in range(3))
    with pytest.raises(Conflict, match="no room"):
        for moved, other in itertools.cycle([(c, b), (b, c)]):
            queue.move(moved, other)
    assert a == queue.row()[0]


def test_what_comes_back_is_the_first_of_its_priority() -> None:
    queue = Queue()
    taken, urgent = queue.add("a"), queue.add("a", 3)
    waiting = queue.add("b")
    back = replace(queue.orders[taken], rank=rank_of_first(queue.orders.values(), 0))
    queue.orders[taken] = back
    assert queue.row() == [urgent, taken, waiting]


# -- robots -----------------------------------------------------------------------------------------------------------


def robot(name: str, **more: Any) -> Robot:
    said: dict[str, Any] = {
        "name": name, "online": True, "settings": {}, "lease": None, "parts": {}, "model": None, "description": None,
    }  # fmt: skip
    return cast(Robot, SimpleNamespace(**said | more))


def part(kind: str, charge: float | None = None) -> Any:
    types = (SimpleNamespace(value=f"https://w3id.org/linked-fleet#{kind}"),)
    return SimpleNamespace(types=types, offers={}, battery_percent=charge)


def at(x: float, y: float) -> Any:
    model = SimpleNamespace(root="base", joints={})
    return {"model": model, "link_pose": lambda link: Pose((x, y, 0.0), UPRIGHT)}


def robots(*these: Robot, taken: Mapping[str, str] | None = None, moving: tuple[str, ...] = ()) -> Robots:
    known = {each.name: each for each in these}
    frame = Pose((0.0, 0.0, 0.0), UPRIGHT)
    return Robots(known, moving, dict(taken or {}), Abilities(), (lambda _: frame,))


def order(**more: Any) -> Order:
    return Order(Wanted("http://a/missions/m", **more))


def test_an_order_gets_all_its_robots_or_none() -> None:
    fleet = robots(robot("a"), robot("b"), taken={"b": "other"})
    turn = decide("1", order(), Need(("a", "b")), fleet)
    assert not turn.robots and turn.reason == "waits for b, which has another order"
    free = robots(robot("a"), robot("b"))
    assert decide("1", order(), Need(("b", "a")), free).robots == ("a", "b")
    assert decide("2", order(), Need(("a",)), free).reason == "waits for a, which has another order"


def test_an_order_of_many_robots_is_not_overtaken_for_ever() -> None:
    fleet = robots(robot("a"), robot("b"), taken={"b": "other"})
    decide("1", order(), Need(("a", "b")), fleet)
    assert decide("2", order(), Need(("a",)), fleet).reason == "waits for a, which is kept for an order before this one"


def test_an_order_for_a_robot_that_is_away_keeps_nobody_waiting() -> None:
    fleet = robots(robot("a"), robot("b", online=False))
    assert decide("1", order(), Need(("a", "b")), fleet).reason == "waits for b, which is offline"
    assert decide("2", order(), Need(("a",)), fleet).robots == ("a",)


def test_an_order_waits_for_a_robot_whose_stop_holds() -> None:
    fleet = robots(robot("a"), robot("b"))
    fleet.latches = cast(Latches, SimpleNamespace(of={"a": ("1", Latch("a"))}.get))
    assert (
        decide("1", order(), Need(("a",)), fleet).reason
        == "waits for a, which is stopped, and the stop holds until it is reset"
    )
    assert decide("2", order(), Need(("b",)), fleet).robots == ("b",)


@pytest.mark.parametrize(
    ("one", "reason"),
    [
        (robot("a", online=False), "is offline"),
        (robot("a", lease=SimpleNamespace(holder="ann")), "is controlled by ann"),
        (robot("a", settings={"availability": '{"in_service":false,"reason":"worn"}'}), "is out of service: worn"),
        (robot("a", parts={"battery": part("Battery", 12.4)}), "has 12 % of charge, and needs 30 %"),
        (robot("a", parts={"battery": part("Battery")}), "does not say how much charge its battery has"),
        (robot("b"), "is not known"),
    ],
)
def test_it_says_why_a_robot_cannot_have_an_order(one: Robot, reason: str) -> None:
    assert decide("1", order(battery=30.0), Need(("a",)), robots(one)).reason == f"waits for a, which {reason}"


def test_a_robot_that_a_client_moves_is_busy() -> None:
    assert "client" in decide("1", order(), Need(("a",)), robots(robot("a"), moving=("a",))).reason


def test_a_robot_with_enough_charge_or_without_a_battery_gets_the_order() -> None:
    charged = robot("a", parts={"battery": part("Battery", 30.0)})
    assert decide("1", order(battery=30.0), Need(("a",)), robots(charged)).robots == ("a",)
    assert decide("1", order(battery=30.0), Need(("a",)), robots(robot("a"))).robots == ("a",)


def test_of_the_free_robots_that_can_the_nearest_is_taken() -> None:
    fleet = robots(
        robot("far", **at(9, 0)), robot("near", **at(1, 1)), robot("nearest", **at(0, 0)), robot("nowhere"),
        taken={"nearest": "other"},
    )  # fmt: skip
    near = Choice("robot", robots=("far", "near", "nearest", "nowhere"), near=Point(0.0, 0.0))
    able = fleet.able(near, None, lambda iri: iri)
    assert able == ["nearest", "near", "far", "nowhere"]
    turn = decide("1", order(choice=near), Need((), able), fleet)
    assert (turn.robots, turn.chosen) == (("near",), "near")


def test_what_a_choice_says_must_all_be_true_of_a_robot() -> None:
    gripper, base = "https://w3id.org/linked-fleet#Gripper", "https://w3id.org/linked-fleet#Base"
    fleet = robots(
        robot("a", parts={"g": part("Gripper")}), robot("b", parts={"g": part("Gripper"), "b": part("Base")}),
        robot("c"),
    )  # fmt: skip
    assert fleet.able(Choice("robot", kind=gripper), None, str) == ["a", "b"]
    assert fleet.able(Choice("robot", kind=gripper, offers=base), None, str) == ["b"]
    assert fleet.able(Choice("robot", robots=("a", "c"), kind=gripper), None, str) == ["a"]
    assert fleet.able(Choice("robot", kind=gripper, select="…"), {"b", "c"}, str) == ["b"]
    none = decide("1", order(), Need((), ()), fleet)
    assert none.reason == "no robot can: none fits what the order says"


def test_a_choice_whose_robots_are_all_busy_says_which() -> None:
    fleet = robots(robot("a"), robot("b"), robot("c"), taken={"a": "1", "b": "2"})
    turn = decide("3", order(), Need(("c",), ("a", "b")), fleet)
    assert turn.reason == "no robot that can is free: a, which has another order; b, which has another order"
    assert decide("4", order(), Need(("c",)), fleet).robots == ("c",)
