"""Parts of the simulated robots as their agents show them. MuJoCo moves and stops fingers, on the test's own clock."""

from pathlib import Path
from typing import Any

import msgspec
import pytest

from linked_fleet_agent.robots.catalogue import MODELS
from linked_fleet_agent.robots.simulated_parts import MANUAL_SCALE
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.components import DescriptionWithComponents, read_declarations
from linked_fleet_agent.wire.kinds import LF
from linked_fleet_agent.wire.messages import Accepted, Refused
from simulated_bench import Simulated

FINGER = "panda_finger_joint1"


async def holding(source: str = "panda", component: str = "gripper") -> Simulated:
    """Return a robot whose gripper holds something of 3 cm by 20 N."""
    bench = Simulated(source)
    await bench.do(component, "open")
    await bench.do("simulation", "putObject", 0.1, width=0.03, gripper=component)
    assert await bench.do(component, "grasp", force=20.0) == "succeeded"
    assert bench.shown(component)["holding"]
    return bench


KINDS = {
    "baxter": {"left_fingers": "Gripper", "right_fingers": "Gripper"},
    "panda": {"gripper": "Gripper"},
    "ur5": {"tool": "Switch"},
    "tiago": {"battery": "Battery", "mobile_base": "Base"},
    "pmb2": {"battery": "Battery", "mobile_base": "Base"},
    "go2": {"battery": "Battery", "mobile_base": "Base"},
}


@pytest.mark.parametrize("source", sorted(MODELS))
def test_each_robot_declares_its_parts_and_the_simulation(source: str) -> None:
    bench = Simulated(source)
    jogging = {} if source == "pmb2" else {"jogging": "Jogging"}
    links = {"panda_hand", "left_gripper_base_link", "right_gripper_base_link", "tool0", "base_footprint", "base"}
    said = codec.decode(bench.agent.description, DescriptionWithComponents)
    declared, refused = read_declarations(said.components, links, said.joints)
    assert refused == []
    assert {each.name: each.semantic_type.removeprefix(LF) for each in declared} == {
        "mode": "Mode", "diagnostics": "Diagnostics", "simulation": "", **KINDS[source], **jogging,
    }  # fmt: skip
    [simulation] = [each for each in declared if each.name == "simulation"]
    assert simulation.description.startswith("The simulation of this robot, not a part of it")
    assert bench.shown("diagnostics")["status"][0] == {
        "name": "simulation", "level": "ok", "message": "it runs in real time",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("source", "component", "opening"),
    [("panda", "gripper", 0.08), ("baxter", "left_fingers", 0.041666), ("baxter", "right_fingers", 0.041666)],
)
async def test_fingers_stop_at_what_is_between_them_and_push_with_the_requested_force(
    source: str, component: str, opening: float
) -> None:
    bench = Simulated(source)
    assert await bench.do(component, "open") == "succeeded"
    assert bench.shown(component)["width"] == pytest.approx(opening, abs=3e-4)
    assert await bench.do("simulation", "putObject", 0.1, width=0.03, gripper=component) == "succeeded"
    bench.operate("g", "grasp", {"force": 15.0}, component=component)
    await bench.tick(3)
    result = msgspec.json.decode(bench.end("g").result)
    assert bench.end("g").state == "succeeded"
    assert bench.end("g").feedback is not msgspec.UNSET
    assert result["holding"]
    assert result["width"] == pytest.approx(0.03, abs=2e-4)
    await bench.tick(1)
    assert bench.shown(component) == {
        "width": pytest.approx(0.03, abs=2e-4), "force": pytest.approx(15.0, rel=0.02), "holding": True,
    }  # fmt: skip
    assert bench.link.events == []


async def test_fingers_that_reach_their_width_hold_nothing() -> None:
    bench = Simulated("panda")
    await bench.do("gripper", "open")
    for width in (0.02, 0.0):
        assert await bench.do("gripper", "grasp", width=width) == "succeeded"
        shown = bench.shown("gripper")
        assert (shown["width"], shown["holding"]) == (pytest.approx(width, abs=3e-4), False)


async def test_what_is_taken_away_while_it_is_held_is_lost() -> None:
    bench = await holding()
    await bench.do("simulation", "takeObject", 0.5)
    assert [(each.component, each.event) for each in bench.link.events] == [("gripper", "lost")]
    shown = bench.shown("gripper")
    assert (shown["holding"], shown["width"] > 0.028) == (False, True)
    await bench.tick(1)
    assert len(bench.link.events) == 1


async def test_what_is_put_down_is_not_lost() -> None:
    bench = await holding()
    assert await bench.do("gripper", "open", width=0.06) == "succeeded"
    assert bench.shown("gripper")["holding"] is False
    assert bench.link.events == []


async def test_nothing_can_be_put_between_fingers_that_are_closer_or_in_another_gripper() -> None:
    bench = Simulated("baxter")
    for given, said in (
        ({"width": 0.03}, "the fingers are 0 m apart, and 0.03 m must fit between them"),
        ({"width": 0.03, "gripper": "third"}, "no gripper 'third'; it has left_fingers, right_fingers"),
    ):
        bench.operate(f"p{len(given)}", "putObject", given, component="simulation")
        await bench.tick(0.1)
        end = bench.end(f"p{len(given)}")
        assert (end.state, said in end.reason) == ("failed", True), end


async def test_a_stop_leaves_fingers_where_they_are() -> None:
    bench = Simulated("panda")
    await bench.do("gripper", "open")
    bench.operate("g", "grasp", component="gripper")
    await bench.tick(0.2)
    assert bench.fingers.moving
    bench.stop("s")
    await bench.tick(0.1)
    assert bench.states("g") == ["running", "cancelled"]
    stands = bench.fingers.width
    await bench.tick(1)
    assert bench.end("s").state == "succeeded"
    assert 0.01 < bench.fingers.width == pytest.approx(stands, abs=1e-4)
    assert bench.fingers.force < 0.1


@pytest.mark.parametrize("before", [0.08, 0.034])
async def test_what_is_held_stays_held_in_a_stop_and_after_it(before: float) -> None:
    """Also where the fingers have moved by less than the agent takes for sag, since it has sent a setpoint."""
    bench = Simulated("panda")
    await bench.do("gripper", "open", width=before)
    bench.stop("first")
    await bench.tick(1)
    await bench.do("simulation", "putObject", 0.1, width=0.03)
    assert await bench.do("gripper", "grasp") == "succeeded"
    bench.stop("s")
    await bench.tick(1)
    assert bench.end("s").state == "succeeded"
    shown = bench.shown("gripper")
    assert (shown["holding"], shown["width"]) == (True, pytest.approx(0.03, abs=2e-4))
    assert shown["force"] == pytest.approx(20.0, rel=0.02)
    assert bench.link.events == []


async def test_a_motion_of_the_finger_preempts_a_grasp_and_ends_a_grip() -> None:
    bench = Simulated("panda")
    await bench.do("gripper", "open")
    bench.operate("g", "grasp", component="gripper")
    await bench.tick(0.2)
    reply = bench.move("m", **{FINGER: 0.035})
    assert isinstance(reply, Accepted)
    assert reply.preempts == ("g",)
    await bench.tick(3)
    assert (bench.end("g").state, bench.end("g").successor) == ("preempted", "m")
    assert bench.end("m").state == "succeeded"
    assert bench.fingers.width == pytest.approx(0.07, abs=5e-4)

    held = await holding()
    held.move("m", **{FINGER: 0.03})
    await held.tick(3)
    assert held.end("m").state == "succeeded"
    assert held.shown("gripper")["holding"] is False
    assert held.link.events == []


async def test_a_grasp_preempts_a_motion_of_the_finger() -> None:
    bench = Simulated("panda")
    await bench.do("gripper", "open")
    bench.move("m", **{FINGER: 0.0})
    await bench.tick(0.1)
    reply = bench.operate("o", "open", component="gripper")
    assert isinstance(reply, Accepted)
    assert reply.preempts == ("m",)
    await bench.tick(3)
    assert (bench.end("m").state, bench.end("o").state) == ("preempted", "succeeded")
    assert bench.fingers.width == pytest.approx(0.08, abs=5e-4)


async def test_the_arm_moves_while_something_is_held() -> None:
    bench = await holding()
    bench.move("m", panda_joint1=1.0, panda_joint7=-1.0)
    await bench.tick(5)
    assert bench.end("m").state == "succeeded"
    assert bench.shown("gripper")["holding"]
    assert bench.link.events == []


async def test_a_protective_stop_ends_a_grasp_and_keeps_a_grip() -> None:
    bench = Simulated("panda")
    await bench.do("gripper", "open")
    bench.operate("g", "grasp", component="gripper")
    await bench.tick(0.2)
    await bench.do("simulation", "stopProtectively", 0.3, reason="the gate is open")
    assert (bench.end("g").state, bench.end("g").reason) == ("failed", "mode: the gate is open")
    mode = bench.shown("mode")
    assert (mode["protectiveStop"], mode["reason"]) == (True, "the gate is open")
    assert isinstance(bench.operate("h", "grasp", component="gripper"), Refused)
    assert await bench.do("mode", "reset", 0.2) == "succeeded"
    assert await bench.do("gripper", "open") == "succeeded"

    held = await holding()
    await held.do("simulation", "stopProtectively", 1)
    assert held.shown("gripper")["holding"]


async def test_the_speed_is_scaled_and_reduced_in_manual_mode() -> None:
    async def fastest(bench: Simulated, target: float) -> float:
        name = f"m{bench.now_ns}"
        since = len(bench.link.states)
        assert isinstance(bench.move(name, wrist_3_joint=target), Accepted)
        await bench.until(lambda: bench.states(name)[-1:] == ["succeeded"])
        return max(max(map(abs, frame.velocities)) for frame in bench.link.states[since:])

    bench = Simulated("ur5")
    full = await fastest(bench, 1.5)
    await bench.set("mode", "speedScale", 0.5)
    await bench.until(lambda: bench.shown("mode")["speedScale"] == 0.5)
    assert 0.4 * full < await fastest(bench, 0.0) < 0.6 * full
    await bench.set("mode", "mode", "manual")
    await bench.until(lambda: bench.shown("mode")["speedScale"] == MANUAL_SCALE)
    assert 0.2 * full < await fastest(bench, 1.5) < 0.3 * full
    assert isinstance(bench.operate("x", "", 0.0, property="speedScale", component="mode"), Refused)


@pytest.mark.parametrize("source", ["tiago", "go2"])
async def test_a_battery_drains_with_time_and_with_work_and_is_charged(source: str) -> None:
    bench = Simulated(source)
    battery: Any = next(each for each in bench.mujoco.components() if each.name == "battery")

    async def used(seconds: float) -> float:
        before = battery.energy_j
        await bench.tick(seconds)
        return float(before - battery.energy_j)

    await bench.tick(1)
    at_rest = await used(1)
    assert at_rest == pytest.approx(60, rel=0.2)
    joint = "arm_1_joint" if source == "tiago" else "FL_thigh_joint"
    bench.move("m", **{joint: 1.1})
    assert await used(1) > at_rest + 1
    battery.energy_j /= 2
    await bench.until(lambda: bench.shown("battery")["charge"] < 51)
    assert bench.shown("battery")["powerSupplyState"] == "discharging"
    await bench.set("simulation", "charger", True)
    assert await used(1) < -150
    await bench.until(lambda: bench.shown("battery")["powerSupplyState"] == "charging")
    battery.energy_j = battery._full_j - 1
    await bench.until(lambda: bench.shown("battery") == {"charge": 100.0, "powerSupplyState": "full"})
    battery.energy_j, battery.charger = 1.0, False
    await bench.until(lambda: bench.shown("battery")["charge"] == 0.0)


async def test_the_tool_has_an_output_that_is_set_and_an_input_that_the_simulation_sets() -> None:
    bench = Simulated("ur5")
    assert bench.shown("tool") == {"output": False, "input": False}
    await bench.set("tool", "output", True)
    await bench.until(lambda: bench.shown("tool") == {"output": True, "input": False})
    assert isinstance(bench.operate("i", "", True, property="input", component="tool"), Refused)
    await bench.set("simulation", "toolInput", True)
    await bench.until(lambda: bench.shown("tool") == {"output": True, "input": True})


async def test_diagnostics_say_what_the_simulation_knows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a file about what has diverged
    bench = Simulated("panda")

    async def status() -> dict[str, tuple[str, str]]:
        await bench.tick(1.1)
        return {each["name"]: (each["level"], each["message"]) for each in bench.shown("diagnostics")["status"]}

    assert await status() == {
        "simulation": ("ok", "it runs in real time"), "motors": ("ok", "none is at its effort limit"),
    }  # fmt: skip
    bench.now_ns += 800_000_000
    assert (await status())["simulation"][0] == "ok"
    bench.now_ns += 2_300_000_000
    assert (await status())["simulation"] == (
        "warning", "this computer is too slow: of the last 10 s, 2.9 s were left out",
    )  # fmt: skip
    await bench.tick(10)
    assert (await status())["simulation"][0] == "ok"
    await bench.do("gripper", "open")
    await bench.do("simulation", "putObject", 0.1, width=0.03)
    await bench.do("gripper", "grasp", force=100.0)
    assert (await status())["motors"] == ("warning", f"at the effort limit: {FINGER}")
    bench.mujoco._data.qpos[0] = float("nan")
    assert (await status())["simulation"] == ("error", "it has diverged")
    assert bench.shown("simulation")["time"] > 10
