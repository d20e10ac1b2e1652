"""Which contacts are collisions: those into which a robot has moved."""

from linked_fleet_agent.robots.contact_model import Contact
from linked_fleet_demo.contact_watch import BRAKING_S, ContactWatch


def contact(depth_m: float, other: str = "crate", robot: str = "arm") -> Contact:
    return Contact(robot, other, depth_m, f"{robot} touches {other}")


def test_a_robot_that_moves_into_something_is_stopped_once() -> None:
    watch = ContactWatch()
    assert watch.collisions([], {"arm"}, 0.0) == []
    assert watch.collisions([contact(0.006)], {"arm"}, 0.1) == [contact(0.006)]
    assert watch.collisions([contact(0.03)], {"arm"}, 0.2) == [], "while it brakes"
    assert watch.collisions([contact(0.03)], set(), 1.0) == []


def test_a_robot_may_leave_what_it_has_touched_and_not_move_further_into_it() -> None:
    watch = ContactWatch()
    watch.collisions([contact(0.01)], {"arm"}, 0.0)
    later_s = 2 * BRAKING_S
    assert watch.collisions([contact(0.008)], {"arm"}, later_s) == []
    assert watch.collisions([contact(0.02)], {"arm"}, later_s + 0.1) == [contact(0.02)]
    assert watch.collisions([], {"arm"}, 2 * later_s) == []
    assert watch.collisions([contact(0.006)], {"arm"}, 2 * later_s + 0.1) == [contact(0.006)], "it has come back"


def test_what_is_put_against_a_robot_that_stands_does_not_stop_it() -> None:
    watch = ContactWatch()
    assert watch.collisions([contact(0.05)], set(), 0.0) == []
    assert watch.collisions([contact(0.05)], {"arm"}, 0.1) == []


def test_of_two_robots_the_one_that_moves_is_stopped() -> None:
    both = [contact(0.01, "other"), contact(0.01, "arm", "other")]
    assert ContactWatch().collisions(both, {"arm"}, 0.0) == [both[0]]
    assert ContactWatch().collisions(both, {"arm", "other"}, 0.0) == both


def test_a_robot_that_could_not_be_stopped_is_stopped_by_the_next_look() -> None:
    watch = ContactWatch()
    assert watch.collisions([contact(0.006)], {"arm"}, 0.0) == [contact(0.006)]
    watch.not_stopped(contact(0.006))
    assert watch.collisions([contact(0.007)], {"arm"}, 0.1) == [contact(0.007)]
    assert watch.collisions([contact(0.008)], {"arm"}, 0.2) == []
