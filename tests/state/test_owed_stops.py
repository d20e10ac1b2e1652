"""Which of the owed stops of a robot one more stop replaces, and their bounds."""

from collections.abc import Mapping

import pytest

from linked_fleet_agent.wire.messages import WIRE_VERSION, Stop
from linked_fleet_state import owed_stops
from linked_fleet_state.owed_stops import MAX_OF_ONE, OwedStop, OwedStops

_STOPS: Mapping[str, Stop] = {
    id: Stop(version=WIRE_VERSION, id=id, joints=joints, command=command)
    for id, joints, command in (
        ("whole", (), ""),
        ("again", (), ""),
        ("elbow", ("elbow",), ""),
        ("elbow-again", ("elbow",), ""),
        ("wrist", ("wrist",), ""),
        ("motion", (), "m"),
        ("motion-again", (), "m"),
        ("other-motion", (), "n"),
    )
}


def _owed(stops: OwedStops) -> list[str]:
    return [each.stop.id for each in stops.of_robot("r")]


@pytest.mark.parametrize(
    ("asked", "kept"),
    [
        ("whole again", "again"),
        ("elbow wrist", "elbow wrist"),
        ("elbow elbow-again wrist", "elbow-again wrist"),
        ("elbow motion whole", "whole"),
        ("whole elbow motion", "whole elbow motion"),
        ("motion other-motion motion-again", "other-motion motion-again"),
        ("whole whole", "whole"),
    ],
)
def test_a_later_stop_replaces_what_it_covers(asked: str, kept: str) -> None:
    stops, replaced = OwedStops(), set[str]()
    for at_ns, id in enumerate(asked.split()):
        replaced |= {id for _, id in stops.add(OwedStop("r", _STOPS[id], at_ns))}
    assert _owed(stops) == kept.split()
    assert replaced == set(asked.split()) - set(kept.split())


def test_an_earlier_stop_that_is_learned_of_later_replaces_nothing() -> None:
    stops = OwedStops()
    stops.add(OwedStop("r", _STOPS["elbow"], 2))
    assert stops.add(OwedStop("r", _STOPS["whole"], 1)) == []
    assert _owed(stops) == ["elbow", "whole"]


def test_too_many_stops_of_one_robot_become_one_of_the_whole_robot() -> None:
    stops = OwedStops()
    for number in range(MAX_OF_ONE + 1):
        stop = Stop(version=WIRE_VERSION, id=f"s{number}", joints=(f"joint-{number}",))
        dropped = stops.add(OwedStop("r", stop, number))
    (left,) = stops.of_robot("r")
    assert (left.of_whole_robot, left.stop.id, len(dropped)) == (True, f"s{MAX_OF_ONE}", MAX_OF_ONE)


def test_robots_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(owed_stops, "MAX_ROBOTS", 2)
    stops = OwedStops()
    for robot in "abc":
        dropped = stops.add(OwedStop(robot, _STOPS["whole"], 0))
    assert (dropped, len(stops), "a" in stops) == ([("a", "whole")], 2, False)


def test_a_robot_whose_stops_are_confirmed_is_owed_none() -> None:
    stops = OwedStops()
    for at_ns, id in enumerate(("whole", "elbow")):
        stops.add(OwedStop("r", _STOPS[id], at_ns))
    assert stops.settle(("r", "nobody's")) is None
    assert stops.settle(("r", "whole")) is not None
    assert "r" in stops
    assert stops.settle(("r", "elbow")) is not None
    assert ("r" in stops, len(stops)) == (False, 0)
