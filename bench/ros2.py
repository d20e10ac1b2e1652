"""Robots of ROS 2: what an agent costs with twenty joints at 100 Hz, how fast goals are accepted, and restarts.

The robots are real (``make ros-peers``): that of hiroz over rmw_zenoh, and that of rclpy behind the bridge. Most of
their joints move. Goals go to the robot of hiroz, beside bare queries of Zenoh with the same bytes.
"""

import asyncio
import statistics
import tempfile
import time
import uuid
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, closing
from pathlib import Path

from bench.scene import cpu_s, pid_of
from bench.table import Row, UnavailableError, bounded, within
from linked_fleet_agent.robots.ros2.goals import ActionClient
from linked_fleet_agent.robots.ros2.graph import Interface
from linked_fleet_agent.robots.ros2.session import RosSession
from linked_fleet_agent.robots.ros2.types import MessageTypes
from ros_fleet import PARTS, restarts, ros_fleet
from ros_peers import ARM, HIROZ_ROBOT, Build, behind_bridge, on_rmw_zenoh
from running import Process, eventually, process
from small_fleet import Place, live

JOINTS, OF_ARM, GOALS = 20, 3, 200
SETTLED_S = 3.0
RESTARTS, HEALED_S = 12, 10.0
MOST_PERCENT, MOST_TIMES = 5.0, 3.0
# The least of such an agent: it keeps the newest joint state, and publishes a ready frame a hundred times a second.
_BARE = """
import asyncio, sys
import zenoh
from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.zenoh_session import configuration
ros, fleet, key, payload = *sys.argv[1:4], bytes(int(sys.argv[4]))
newest = [None]
def take(sample):
    newest[0] = sample.payload.to_bytes()
async def main():
    loop = asyncio.get_running_loop()
    def due():
        publisher.put(payload)
        loop.call_at(loop.time() + 0.01, due)
    due()
    print("runs", flush=True)
    await asyncio.Event().wait()
with zenoh.open(configuration((ros,), (), 2_000)) as one, zenoh.open(configuration((fleet,), (), 2_000)) as other:
    subscriber = one.declare_subscriber(key, zenoh.handlers.Callback(take, indirect=False))
    drop = zenoh.CongestionControl.DROP
    publisher = other.declare_publisher(Keys().robot("bare", "state"), congestion_control=drop)
    asyncio.run(main())
"""
_FRAME_BYTES = 40 + 3 * 8 * JOINTS
_KEYS = {"ros2:": "0/joint_states/**", "ros2dds:": "joint_states"}
NAVIGATE = "nav2_msgs/action/NavigateToPose"


def rows(seconds: float) -> list[Row]:
    """Return the share of a core of an agent by transport, and the medians of goals."""
    if not HIROZ_ROBOT.exists():
        raise UnavailableError("the robots of ROS 2 are not built: make ros-peers")
    costs = [_cost(scheme, robot, seconds) for scheme, robot in (("ros2:", on_rmw_zenoh), ("ros2dds:", behind_bridge))]
    return [*costs, *_goals(), *(_restarts(side) for side in PARTS)]


def urdf(more: int) -> str:
    """Return the arm of the real robots with so many joints more, in a chain."""
    links = "".join(f'<link name="l{each}"/>' for each in range(more))
    chain = "".join(
        f'<joint name="j{each}" type="revolute"><parent link="{f"l{each - 1}" if each else "base"}"/>'
        f'<child link="l{each}"/><axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="1" effort="5"/></joint>'
        for each in range(more)
    )
    return ARM.urdf.read_text().replace("</robot>", f"{links}{chain}</robot>")


def _cost(scheme: str, running: Callable[..., AbstractContextManager[str]], seconds: float) -> Row:
    """Measure an agent of a robot of which most joints move, and all are stated with position, velocity and effort."""
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        place, described = Place(Path(folder)), Path(folder) / "robot.urdf"
        described.write_text(urdf(JOINTS - OF_ARM))
        at = stack.enter_context(running(build=Build(described, JOINTS - OF_ARM)))
        _, browser = stack.enter_context(place.gateway())
        agent = stack.enter_context(
            process("-m", "linked_fleet_agent", f"--robot=r={scheme}{at}", "--connect", place.zenoh)
        )
        live(browser, "r")
        percent = _percent(agent, seconds)
        bare = stack.enter_context(process("-c", _BARE, at, place.zenoh, _KEYS[scheme], str(_FRAME_BYTES)))
        bare.said("runs")
        least = _percent(bare, seconds)
    name, reference = f"agent of {JOINTS} joints at 100 Hz, {scheme}", f"bare sessions that do the same: {least:.1f} %"
    return Row(
        name, "% of a core", percent, reference, percent / least, f"<= {MOST_PERCENT:g} %", percent <= MOST_PERCENT
    )


def _percent(child: Process, seconds: float) -> float:
    """Return the share of a core of all threads of a process, once it has settled."""
    time.sleep(SETTLED_S)
    before_s, began_s = cpu_s(pid_of(child)), time.monotonic()
    time.sleep(max(seconds, 10.0))
    return 100.0 * (cpu_s(pid_of(child)) - before_s) / (time.monotonic() - began_s)


def _restarts(side: str) -> Row:
    """Restart router, bridge, robot, agents and gateway in any order, until the robots of all agents can be used."""
    with tempfile.TemporaryDirectory() as folder, ros_fleet(Path(folder), side, without=()) as (running, fleet):
        slowest_s = max(restarts(running, fleet, side, RESTARTS))
    return bounded(f"robots usable after {RESTARTS} restarts, {side}:, slowest", "s", slowest_s, HEALED_S)


def _goals() -> list[Row]:
    with on_rmw_zenoh() as where:
        types = MessageTypes()
        with closing(RosSession(where, 0, "bench", types.hash_of)) as session:
            client = eventually(lambda: _client(session, types), "the action of the robot")
            goal_ms, bare_ms = asyncio.run(_timed(session, client))
    return [within("goal accepted, p50", goal_ms, "bare query, p50", bare_ms, MOST_TIMES)]


def _client(session: RosSession, types: MessageTypes) -> ActionClient | None:
    client = ActionClient(session, types, "/navigate_to_pose", NAVIGATE)
    return client if client.is_available else None


async def _timed(session: RosSession, client: ActionClient) -> tuple[float, float]:
    """Return the medians in ms of goals by the client, and of the same requests as bare calls of the session."""
    service = Interface(f"{client.name}/_action/send_goal", f"{NAVIGATE}_SendGoal")
    goals, bare = list[float](), list[float]()
    for each in range(GOALS):
        goal = {"pose": {"header": {"frame_id": "map"}, "pose": {"position": {"x": float(each % 5)}}}}
        began_s = time.perf_counter()
        await client.send(uuid.uuid4().bytes, goal)
        goals.append(time.perf_counter() - began_s)
        request = client.type.send_goal.request.write({"goal_id": {"uuid": uuid.uuid4().bytes}, "goal": goal})
        began_s = time.perf_counter()
        await session.call(service, request, 65_536)
        bare.append(time.perf_counter() - began_s)
        await client.cancel_all()
    return 1e3 * statistics.median(goals), 1e3 * statistics.median(bare)
