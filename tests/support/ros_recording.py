"""What real programs of ROS 2 say, as JSON: messages, hashes, tokens, keys, and a service and an action in use.

``PYTHONPATH=tests/support:tests python tests/support/ros_recording.py`` writes tests/agents/ros2/peers/recording.json
anew, after ``make ros-peers``. What differs from run to run is replaced: identifiers, numbers, times.
"""

import json
import os
import re
import struct
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import zenoh

from needs import missing
from ros_peers import PYTHON, SOURCES, behind_bridge, on_humble, on_rmw_zenoh, ros_environment
from running import eventually

RECORDING = SOURCES / "recording.json"
GOAL, OTHER_GOAL, NO_GOAL = (bytes(range(begin, begin + 16)) for begin in (1, 33, 65))
GID = bytes(range(101, 117))
_PAUSE_S = 0.3
_HEAD = b"\x00\x01\x00\x00"
_NO_STAMP = bytes(8)
_FIBONACCI = "fibonacci/_action"


def recording() -> dict[str, Any]:
    """Return what the programs say now."""
    with on_rmw_zenoh(_PAUSE_S) as endpoint, _client(endpoint) as session:
        rmw_zenoh = _RmwZenoh(session).record()
    with on_humble(_PAUSE_S) as endpoint, _client(endpoint) as session:
        humble = _RmwZenoh(session).record()
    with behind_bridge(_PAUSE_S) as endpoint, _client(endpoint) as session:
        bridge = _Bridge(session).record()
    return {"messages": messages(), "rmw_zenoh": rmw_zenoh, "humble": humble, "bridge": bridge}


def messages() -> dict[str, Any]:
    """Return messages of rclpy by their types: values, bytes and hash."""
    if not PYTHON.exists():
        missing("rclpy", "make ros-peers")
    command = [PYTHON, SOURCES / "rclpy_messages.py"]
    environment = os.environ | ros_environment(domain=0) | {"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    said: dict[str, Any] = json.loads(done.stdout)
    return said


@contextmanager
def _client(endpoint: str) -> Iterator[zenoh.Session]:
    config = zenoh.Config()
    for name, value in {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "scouting/multicast/enabled": False,
        "timestamping/enabled": True,
    }.items():
        config.insert_json5(name, json.dumps(value))
    with zenoh.open(config) as session:
        yield session


class _Bridge:
    """The robot of rclpy by zenoh-bridge-ros2dds."""

    tokens = "@/*/@ros2_lv/**"
    last = ("/AS/fibonacci/", "/AS/fastdds§fibonacci/", "/AC/fastdds§fibonacci/", "/MP/diagnostics/", "/SS/silence/")

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session

    def record(self) -> dict[str, Any]:
        eventually(self._all_is_there, "the tokens of all that the robot has")
        eventually(lambda: self.call("set_lamp", b"\x00") is not None, "an answer of set_lamp")
        feedback, status = self.hear(f"{_FIBONACCI}/feedback"), self.hear(f"{_FIBONACCI}/status")
        exchange = self.exchange()
        eventually(lambda: feedback[1] and status[1] and status[1][-1].endswith("05"), "the last status")
        return {
            "tokens": sorted(map(self.stable, self._tokens())),
            "exchange": exchange,
            "feedback": {"key": feedback[0], "messages": feedback[1]},
            "status": {"key": status[0], "messages": status[1]},
        }

    def _all_is_there(self) -> bool:
        return all(any(each in token for token in self._tokens()) for each in self.last)

    def exchange(self) -> list[dict[str, Any]]:
        """Call a service, let one goal end, cancel another, and ask for what is not there."""
        goal, cancel, result = (f"{_FIBONACCI}/{part}" for part in ("send_goal", "cancel_goal", "get_result"))
        questions = [
            ("set_lamp", b"\x01"),
            ("home", b"\x00"),
            (goal, NO_GOAL + struct.pack("<i", -1)),
            (goal, GOAL + struct.pack("<i", 4)),
            (result, GOAL),
            (result, GOAL),
            (goal, OTHER_GOAL + struct.pack("<i", 100)),
            (cancel, bytes(16) + _NO_STAMP),
            (result, OTHER_GOAL),
            (cancel, OTHER_GOAL + _NO_STAMP),
            (cancel, NO_GOAL + _NO_STAMP),
        ]
        return [self._asked(name, body) for name, body in questions]

    def _asked(self, name: str, body: bytes) -> dict[str, Any]:
        reply = self.call(name, body)
        assert reply is not None, name
        said = {"key": str(reply.key_expr), "request": (_HEAD + body).hex(), "reply": _stable(name, reply.payload)}
        if reply.attachment is not None:
            said["attachment"] = _without_time(reply.attachment)
        return said

    def call(self, name: str, body: bytes) -> zenoh.Sample | None:
        for reply in self._session.get(self.key(name), payload=_HEAD + body, timeout=20.0, **self.more()):
            return reply.ok
        return None

    def more(self) -> dict[str, Any]:
        return {}

    def key(self, name: str) -> str:
        return name

    def hear(self, name: str) -> tuple[str, list[str]]:
        """Return the key of a topic, and the list that its messages will be in."""
        heard: list[str] = []
        self._session.declare_subscriber(self.key(name), lambda said: heard.append(_stable(name, said.payload)))
        return self.key(name), heard

    def stable(self, token: str) -> str:
        return re.sub(r"^@/[0-9a-f]+/", "@/ID/", token)

    def _tokens(self) -> list[str]:
        found = self._session.liveliness().get(self.tokens)
        return [str(reply.ok.key_expr) for reply in found if reply.ok is not None]


class _RmwZenoh(_Bridge):
    """The robot of hiroz on rmw_zenoh."""

    tokens = "@ros2_lv/0/**"
    last = ("%navigate_to_pose%_action%status",)

    def more(self) -> dict[str, Any]:
        return {"attachment": struct.pack("<qqB", 7, 1, 16) + GID, "consolidation": zenoh.ConsolidationMode.NONE}

    def key(self, name: str) -> str:
        named = "%" + name.replace("/", "%")
        (of,) = (each.split("/") for each in self._tokens() if each.split("/")[9:10] == [named])
        return "/".join((of[1], name, of[10], of[11]))

    def stable(self, token: str) -> str:
        return re.sub(r"^(@ros2_lv/0)/[0-9a-f]+/0/[0-9]+/", r"\1/ID/0/NUMBER/", token)


def _stable(name: str, payload: zenoh.ZBytes) -> str:
    """Return the bytes of a message in hexadecimal, without the padding at its end and with all stamps zero."""
    said = payload.to_bytes()
    if name.endswith("send_goal"):
        said = said[:8] + _NO_STAMP
    elif name.endswith("cancel_goal"):
        said = said[:12] + b"".join(said[at : at + 16] + _NO_STAMP for at in range(12, len(said), 24))
    elif name.endswith("status"):
        said = _sorted_statuses(said)
    elif name in ("set_lamp", "home"):
        said = said[: 12 + said[8]]
    return said.hex()


def _sorted_statuses(said: bytes) -> bytes:
    """Return a GoalStatusArray sorted by goals: each a UUID, a stamp, which is aligned to four bytes, and a status."""
    goals, at = [], 8
    for _ in range(said[4]):
        stamp = at + 16 + -(at + 16) % 4
        goals.append((said[at : at + 16], said[stamp + 8 : stamp + 9]))
        at = stamp + 9
    out = said[:8]
    for goal, status in sorted(goals):
        out += goal
        out += bytes(-len(out) % 4) + _NO_STAMP + status
    return out


def _without_time(attachment: zenoh.ZBytes) -> str:
    said = attachment.to_bytes()
    return (said[:8] + bytes(8) + said[16:]).hex()


def _text(said: dict[str, Any]) -> str:
    """Return the JSON with one message in each line."""
    lines = [f"  {json.dumps(name)}: {json.dumps(each, ensure_ascii=False)}" for name, each in said["messages"].items()]
    rest = {name: json.dumps(said[name], indent=1, ensure_ascii=False) for name in ("rmw_zenoh", "humble", "bridge")}
    parts = [f'"{name}": {value}' for name, value in rest.items()]
    return "{\n" + ",\n".join(['"messages": {\n' + ",\n".join(lines) + "\n}", *parts]) + "\n}\n"


if __name__ == "__main__":
    RECORDING.write_text(_text(recording()))
