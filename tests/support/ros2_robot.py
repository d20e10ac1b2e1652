"""A ROS 2 robot on Zenoh: the messages, keys and cache of rmw_zenoh, and a trajectory controller that interpolates.

Keys are spelt out here, and messages made by rosbags, so that the driver is not tested against itself.
"""

import json
import math
import signal
import struct
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from typing import Any, Self

import numpy as np
import zenoh
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.stores import ros2_kilted as ros
from zenoh import ext

STORE = get_typestore(Stores.ROS2_KILTED)
STRING = "std_msgs::msg::dds_::String_/RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
STATE = "sensor_msgs::msg::dds_::JointState_/RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"
TRAJECTORY = (
    "trajectory_msgs::msg::dds_::JointTrajectory_/"
    "RIHS01_179b33eba59d676f6d967ac71fe35e7ca2f64b2f3928f4a018cec115e213796e"
)
URDF = """<robot name="Stand-in">
  <link name="base"/><link name="head"/><link name="arm"/><link name="finger"/><link name="thumb"/>
  <joint name="pan" type="revolute"><parent link="base"/><child link="head"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" velocity="1" effort="5"/></joint>
  <joint name="lift" type="prismatic"><parent link="head"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="0.5" velocity="0.2" effort="50"/></joint>
  <joint name="grip" type="revolute"><parent link="arm"/><child link="finger"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="1" velocity="1" effort="5"/></joint>
  <joint name="thumb_grip" type="revolute"><parent link="arm"/><child link="thumb"/><axis xyz="1 0 0"/>
    <mimic joint="grip"/><limit lower="0" upper="1" velocity="1" effort="5"/></joint>
</robot>"""
PERIOD_S = 0.01


def joint_state(
    names: Sequence[str],
    positions: Sequence[float] = (),
    velocities: Sequence[float] = (),
    efforts: Sequence[float] = (),
    stamp_ns: int = 0,
    little_endian: bool = True,
) -> bytes:
    stamp = ros.builtin_interfaces__msg__Time(*divmod(stamp_ns, 1_000_000_000))
    rows = (np.array(row, dtype=np.float64) for row in (positions, velocities, efforts))
    said = ros.sensor_msgs__msg__JointState(ros.std_msgs__msg__Header(stamp, "base"), list(names), *rows)
    return bytes(STORE.serialize_cdr(said, said.__msgtype__, little_endian=little_endian))


def text(content: str) -> bytes:
    return bytes(STORE.serialize_cdr(ros.std_msgs__msg__String(content), "std_msgs/msg/String", little_endian=True))


class RosRobot:
    """Listens at ``endpoint`` like a ROS router, and has ``positions`` at first.

    One controller has all joints that mimic no other, and by default rejects a trajectory that lacks one of them.
    """

    def __init__(
        self,
        endpoint: str,
        domain: int = 0,
        urdf: str | None = URDF,
        namespace: str = "",
        positions: Mapping[str, float] | None = None,
    ) -> None:
        self.endpoint, self._urdf, self._prefix = endpoint, urdf, f"{domain}{namespace}/"
        self.positions = dict(positions or {"pan": 0.25, "lift": 0.1, "grip": 0.5})
        self.heard: list[Any] = []
        self.refused = 0
        self._from, self._to, self._begun_s, self._lasts_s = {}, dict(self.positions), 0.0, 0.0
        self._ended, self._sequence, self._lock = threading.Event(), 0, threading.Lock()

    def __enter__(self) -> Self:
        config = zenoh.Config()
        for key, value in {
            "mode": "router",
            "listen/endpoints": [self.endpoint],
            "scouting/multicast/enabled": False,
            "timestamping/enabled": True,
            "transport/shared_memory/enabled": False,
        }.items():
            config.insert_json5(key, json.dumps(value))
        self.session = zenoh.open(config)
        self._states = self.session.declare_publisher(self._key("joint_states", STATE))
        self._description = ext.declare_advanced_publisher(
            self.session,
            self._key("robot_description", STRING),
            cache=ext.CacheConfig(1),
            publisher_detection=True,
        )
        if self._urdf is not None:
            self._description.put(text(self._urdf), attachment=self._attached())
        self._controller = self.session.declare_subscriber(
            self._key("joint_trajectory_controller/joint_trajectory", TRAJECTORY), self._obey
        )
        self._thread = threading.Thread(target=self._live)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.fall_silent()
        self.session.close()

    def fall_silent(self) -> None:
        """Stop sending joint states."""
        self._ended.set()
        self._thread.join()

    def say(self, payload: bytes) -> None:
        """Publish any payload as joint state."""
        self._states.put(payload, attachment=self._attached())

    def place(self, name: str, position: float) -> None:
        """Move a joint without the controller."""
        with self._lock:
            self.positions[name] = position
            self._from, self._to = {}, dict(self.positions)

    def leave_controller(self) -> None:
        """Stop the controller: nothing listens for trajectories any more."""
        self._controller.undeclare()

    def tokens(self) -> list[str]:
        """Return the liveliness tokens of other participants in the ROS graph."""
        found = self.session.liveliness().get("@ros2_lv/**")
        return sorted(str(reply.ok.key_expr) for reply in found if reply.ok is not None)

    def _key(self, name: str, type_and_hash: str) -> str:
        return f"{self._prefix}{name}/{type_and_hash}"

    def _live(self) -> None:
        due_s = time.monotonic()
        while not self._ended.wait(max(0.0, due_s - time.monotonic())):
            due_s += PERIOD_S
            with self._lock:
                self._move(time.monotonic())
                follower = {"thumb_grip": self.positions["grip"]} if "grip" in self.positions else {}
                at = {**self.positions, **follower}
            self.say(joint_state(list(at), list(at.values()), [0.0] * len(at), stamp_ns=time.time_ns()))

    def _move(self, now_s: float) -> None:
        share = min(1.0, (now_s - self._begun_s) / self._lasts_s) if self._lasts_s else 1.0
        if self._from:
            self.positions = {name: at + share * (self._to[name] - at) for name, at in self._from.items()}

    def _obey(self, sample: zenoh.Sample) -> None:
        assert sample.attachment is not None
        said: Any = STORE.deserialize_cdr(sample.payload.to_bytes(), "trajectory_msgs/msg/JointTrajectory")
        with self._lock:
            self.heard.append(said)
            if set(said.joint_names) != set(self.positions) or len(said.points) != 1:
                self.refused += 1
                return
            (point,) = said.points
            assert point.time_from_start.nanosec > 0
            assert all(math.isfinite(position) for position in point.positions)
            self._move(time.monotonic())
            self._from, self._to = dict(self.positions), dict(zip(said.joint_names, point.positions, strict=True))
            self._begun_s = time.monotonic()
            self._lasts_s = point.time_from_start.sec + point.time_from_start.nanosec / 1e9

    def _attached(self) -> bytes:
        self._sequence += 1
        return struct.pack("<qqB", self._sequence, time.time_ns(), 16) + bytes(range(16))


class BridgedRobot(RosRobot):
    """The same robot behind zenoh-bridge-ros2dds: keys are names, and a token says that the bridge is there."""

    def __enter__(self) -> Self:
        super().__enter__()
        self._token = self.session.liveliness().declare_token(f"@/{self.session.info.zid()}/@ros2_lv")
        return self

    def _key(self, name: str, type_and_hash: str) -> str:
        return name


if __name__ == "__main__":
    with RosRobot(sys.argv[1]) as it:
        print(f"a robot of ROS 2 at {it.endpoint}", flush=True)
        signal.pause()
