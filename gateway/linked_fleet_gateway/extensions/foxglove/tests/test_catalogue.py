"""Channels, services and parameters beside a robot that cannot be described."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

from linked_fleet_base.faults import Faults
from linked_fleet_gateway.extensions.foxglove import catalogue
from linked_fleet_gateway.extensions.foxglove.catalogue import Catalogue
from linked_fleet_identity.rights import EVERYBODY
from mirrored_fleet import MirroredFleet


@pytest.mark.parametrize(
    ("broken", "named"),
    [("offers_at", "services"), ("cameras_of", "channels"), ("named_poses", "parameters")],
)
def test_the_others_are_listed(monkeypatch: pytest.MonkeyPatch, broken: str, named: str) -> None:
    usual, fleet, faults = getattr(catalogue, broken), MirroredFleet(), Faults()

    def fails(robot: Any) -> Any:
        if robot is not None and robot.name == "bad":
            raise RuntimeError("planted")
        return usual(robot)

    for name in ("bad", "good"):
        fleet.describe(name)
    monkeypatch.setattr(catalogue, broken, fails)
    found = Catalogue(cast(Any, SimpleNamespace(robots=fleet.fleet.robots, faults=faults)), True)
    assert found.update()
    parameters = found.parameters(EVERYBODY)
    listed = {
        "services": {each.offer.path for each in found.services.values()},
        "channels": set(found.by_topic),
        "parameters": set(parameters),
    }
    assert all(any(path.startswith("/good/") for path in paths) for paths in listed.values())
    assert {kind for kind, paths in listed.items() if any("/bad/" in path for path in paths)} == {*listed} - {named}
    assert faults.find("Foxglove", "bad", f"its {named}").endswith("RuntimeError: planted")
