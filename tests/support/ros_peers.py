"""Real programs of ROS 2, which ``make ros-peers`` builds: see tests/agents/ros2/peers/README.md."""

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple, Self

from needs import missing
from running import ROOT, Process, free_port, process

SOURCES = ROOT / "tests/agents/ros2/peers"
BUILT = ROOT / "build/ros-peers"
PYTHON, BRIDGE = BUILT / "python/bin/python", BUILT / "bin/bridge"
HIROZ_ROBOT, ROBOT_OF_HUMBLE = BUILT / "bin/hiroz_robot", BUILT / "bin/hiroz_robot_of_humble"
URDF = SOURCES / "arm.urdf"
_DISCOVERY_S, _MOST_STARTS = 10.0, 4
# Cyclone DDS as the bridge configures it for the same range of discovery: this machine, without multicast.
_CYCLONE = """<CycloneDDS><Domain><General><AllowMulticast>false</AllowMulticast></General><Discovery>
<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>
<Peers><Peer address="localhost"/></Peers></Discovery></Domain></CycloneDDS>"""


def endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


def free_domain() -> int:
    """Return a domain of DDS that no other worker of the tests uses: each has 25 of 100, and ports of its own."""
    port = free_port()
    return 1 + port // 5000 % 4 * 25 + port % 25


def ros_environment(domain: int) -> dict[str, str]:
    """Return the environment of nodes that see those of this machine and domain alone."""
    return {"ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DISTRO": "kilted"}


@contextmanager
def peer(program: Path, *arguments: str, environment: dict[str, str] | None = None) -> Iterator[Process]:
    """Run a program until the end of the block, and wait until it is ready."""
    if not program.exists():
        missing(f"{program.name} of ROS 2", "make ros-peers")
    child = Process(arguments, str(program), environment)
    try:
        child.said('"ready"')
        yield child
    finally:
        child.stop()


def found_within(seconds: float, probe: Callable[[], bool]) -> bool:
    """Return True as soon as ``probe`` does, or False after so many seconds."""
    deadline = time.monotonic() + seconds
    while not probe() and time.monotonic() < deadline:
        time.sleep(0.05)
    return probe()


def _finds_the_robot(child: Process) -> Callable[[], bool]:
    return lambda: "Route Publisher (ROS:/diagnostics ->" in child.output


class Build(NamedTuple):
    """How a robot is built: a file with its URDF, and so many joints more, j0 and so on, which swing to and fro."""

    urdf: Path = URDF
    more_joints: int = 0

    @property
    def environment(self) -> dict[str, str]:
        return {"MORE_JOINTS": str(self.more_joints)}


ARM = Build()


def rclpy_robot(domain: int, pause_s: float = 0.1, build: Build = ARM) -> AbstractContextManager[Process]:
    """Run the robot of rclpy; ``pause_s`` is between two numbers of its action."""
    environment = ros_environment(domain) | {"CYCLONEDDS_URI": _CYCLONE} | build.environment
    return peer(PYTHON, str(SOURCES / "rclpy_robot.py"), str(pause_s), str(build.urdf), environment=environment)


@contextmanager
def bridge(where: str, domain: int, options: str = "") -> Iterator[Process]:
    """Run the bridge, which listens at ``where``, and wait until it has found the robot of rclpy.

    ``options`` as in ``namespace: "/arm", ``. About one bridge in twenty-five never gets what Fast DDS tells of nodes
    (``ros_discovery_info``), and is started again.
    """
    plugin = f'{{{options}domain: {domain}, ros_automatic_discovery_range: "LOCALHOST"}}'
    environment = ros_environment(domain) | {"RUST_LOG": "zenoh_plugin_ros2dds=info"}
    with ExitStack() as stack:
        for _ in range(_MOST_STARTS):
            attempt = stack.enter_context(ExitStack())
            child = attempt.enter_context(peer(BRIDGE, where, plugin, environment=environment))
            if found_within(_DISCOVERY_S, _finds_the_robot(child)):
                yield child
                return
            attempt.close()
        raise AssertionError("no bridge found the robot of rclpy")


def hiroz_robot(
    router: str, pause_s: float = 0.1, build: Build = ARM, program: Path = HIROZ_ROBOT
) -> AbstractContextManager[Process]:
    """Run the robot on rmw_zenoh at a router; ``pause_s`` is between two steps of its actions."""
    environment = {"ROS_DOMAIN_ID": "0"} | build.environment
    return peer(program, router, str(pause_s), str(build.urdf), environment=environment)


@contextmanager
def router(where: str) -> Iterator[Process]:
    """Run a Zenoh router, as ``rmw_zenohd`` is one."""
    with process("tests/support/zenoh_router.py", where) as child:
        child.said("routing")
        yield child


class Restarting:
    """Programs by names, which a test stops, starts and restarts. All are stopped at the end of the block."""

    def __init__(self, **programs: Callable[[], AbstractContextManager[object]]) -> None:
        """Each is what makes a program that runs in a ``with`` block; they start in this order."""
        self._programs, self._running = programs, dict[str, ExitStack]()

    def __enter__(self) -> Self:
        try:
            for name in self._programs:
                self.start(name)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        for name in reversed(list(self._running)):
            self.stop(name)

    def start(self, name: str) -> None:
        with ExitStack() as stack:
            stack.enter_context(self._programs[name]())
            self._running[name] = stack.pop_all()

    def stop(self, name: str) -> None:
        self._running.pop(name).close()

    def restart(self, *names: str) -> None:
        """Stop all of them, then start them in this order."""
        for name in names:
            self.stop(name)
        for name in names:
            self.start(name)


@contextmanager
def on_rmw_zenoh(pause_s: float = 0.1, build: Build = ARM, program: Path = HIROZ_ROBOT) -> Iterator[str]:
    """Run a router with the robot of hiroz, and return its endpoint."""
    with ExitStack() as stack:
        where = endpoint()
        stack.enter_context(router(where))
        stack.enter_context(hiroz_robot(where, pause_s, build, program))
        yield where


def on_humble(pause_s: float = 0.1) -> AbstractContextManager[str]:
    """Run a router with the robot of hiroz as of Humble: no hashes of types, and types of that distribution."""
    return on_rmw_zenoh(pause_s, program=ROBOT_OF_HUMBLE)


@contextmanager
def behind_bridge(pause_s: float = 0.1, options: str = "", build: Build = ARM) -> Iterator[str]:
    """Run the robot of rclpy with a bridge, and return the bridge's endpoint."""
    with ExitStack() as stack:
        where, domain = endpoint(), free_domain()
        stack.enter_context(rclpy_robot(domain, pause_s, build))
        stack.enter_context(bridge(where, domain, options))
        yield where
