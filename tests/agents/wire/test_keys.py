"""Keys are built and parsed by one definition."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_agent.wire.keys import Keys, RobotKey

names = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=32)
namespaces = st.from_regex(r"[A-Za-z0-9_.-]{1,8}(/[A-Za-z0-9_.-]{1,8}){0,3}", fullmatch=True)


@given(namespaces, names, st.sampled_from(["description", "state", "command", "stop", "progress"]))
def test_a_key_of_a_robot_comes_back(namespace: str, robot: str, kind: str) -> None:
    keys = Keys(namespace)
    assert keys.parse(keys.robot(robot, kind)) == RobotKey(robot, kind)  # type: ignore[arg-type]


@given(namespaces, names, st.integers(0, 2**63 - 1))
def test_a_presence_token_comes_back_with_its_incarnation(namespace: str, robot: str, incarnation: int) -> None:
    keys = Keys(namespace)
    assert keys.parse(keys.presence(robot, incarnation)) == RobotKey(robot, "presence", incarnation)


@given(names)
def test_expressions_match_the_keys_they_are_for(robot: str) -> None:
    keys = Keys("site/hall-2")
    assert keys.presence(robot, 7) == keys.all_presence_of_robot(robot).removesuffix("*") + "7"
    for expression, key in (
        (keys.all_presence, keys.presence(robot, 7)),
        (keys.all_states, keys.robot(robot, "state")),
        (keys.all_progress, keys.robot(robot, "progress")),
        (keys.all_conditions, keys.robot(robot, "condition")),
        (keys.all_stops, keys.robot(robot, "stop")),
        (keys.all_gateways, keys.gateway(robot)),
        (keys.all_heartbeats, keys.heartbeat(robot)),
    ):
        assert len(key.split("/")) == len(expression.split("/"))
        assert all(
            pattern in ("*", chunk) for pattern, chunk in zip(expression.split("/"), key.split("/"), strict=True)
        )


@given(names)
def test_the_keys_of_a_gateway_come_back_as_its_name(gateway: str) -> None:
    keys = Keys("site/hall-2")
    assert keys.gateway_of(keys.gateway(gateway)) == keys.gateway_of(keys.heartbeat(gateway)) == gateway


@pytest.mark.parametrize(
    "key", ["", "fleet/gateway", "fleet/gateway/", "fleet/gateway/~61", "fleet/gateway/g/other", "fleet/robot/g/state"]
)
def test_the_key_of_no_gateway_is_refused(key: str) -> None:
    with pytest.raises(ValueError):
        Keys().gateway_of(key)


@pytest.mark.parametrize("namespace", ["", "/fleet", "fleet/", "a//b", "fleet/*", "fleet/$x", "ä", "fleet\n", "@x"])
def test_a_namespace_that_zenoh_would_read_otherwise_is_refused(namespace: str) -> None:
    with pytest.raises(ValueError, match="not a plain Zenoh key"):
        Keys(namespace)


@pytest.mark.parametrize(
    "key",
    [
        "",
        "fleet",
        "fleet/robot/baxter",
        "fleet/robot/baxter/other",
        "fleet/robot/baxter/state/1",
        "fleet/robot/baxter/presence",
        "fleet/robot/baxter/presence/",
        "fleet/robot/baxter/presence/-1",
        "fleet/robot/baxter/presence/007",
        "fleet/robot/baxter/presence/*",
        "fleet/robot/*/state",
        "fleet/robot/a~62/state",
        "fleet/robot/bäxter/state",
        "fleet/robot//state",
        "fleet/gateway/here",
        "fleets/robot/baxter/state",
        "robot/baxter/state",
        "fleet/robot/baxter/state\n",
    ],
)
def test_foreign_keys_are_refused(key: str) -> None:
    with pytest.raises(ValueError):
        Keys().parse(key)
