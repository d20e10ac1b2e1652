"""Records in Redis that gateways of another version wrote, as during an upgrade (docs/UPGRADE.md)."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import msgspec
import pytest

from linked_fleet_agent.wire.messages import WIRE_VERSION, Stop
from linked_fleet_gateway.actions import owed_stop_table
from linked_fleet_gateway.actions import store as invocations
from linked_fleet_gateway.extensions.rules.rule import Rule
from linked_fleet_gateway.extensions.world import scene
from linked_fleet_gateway.resources.subscription import Delivery, DeliveryState
from linked_fleet_gateway.subscriptions import records
from linked_fleet_state.owed_stops import OwedStop
from store_samples import a_rule, a_subscription, an_invocation

OBJECT = msgspec.convert(
    {
        "title": "crate", "kind": "obstacle", "geometry": {"type": "sphere", "radius_m": 0.1},
        "pose": {"position_m": [0, 0, 0], "orientation_xyzw": [0, 0, 0, 1]},
    }, scene.SceneObject,
)  # fmt: skip
STOP = OwedStop("r", Stop(version=WIRE_VERSION, id="s"), 1)


def read_rule(body: bytes) -> Rule:
    return msgspec.json.decode(body, type=Rule)


def read_subscription(body: bytes) -> Any:
    names_and_values = records.write_delivery(Delivery(state=DeliveryState.WAITING))
    fields = {k.encode(): v.encode() for k, v in zip(names_and_values[::2], names_and_values[1::2], strict=True)}
    found = records.read_record({b"spec": body, b"holder": b"g", b"new": b"of another version", **fields})
    return found and replace(found.subscription, revision=0)


READERS: list[tuple[Any, Callable[[bytes], Any]]] = [
    (an_invocation(), lambda body: invocations._read("r", body)),
    (a_rule(), read_rule),
    (OBJECT, scene.decode),
    (STOP, lambda body: owed_stop_table._read(STOP.key, body)),
    (a_subscription(), read_subscription),
]


@pytest.mark.parametrize(("record", "read"), READERS, ids=[type(record).__name__ for record, _ in READERS])
def test_a_field_of_another_version_is_ignored(record: Any, read: Callable[[bytes], Any]) -> None:
    """So gateways before and after an upgrade work on one Redis, and the way back is open."""
    newer = {**msgspec.to_builtins(record), "field_of_a_newer_version": [1]}
    assert read(msgspec.json.encode(newer)) == record
