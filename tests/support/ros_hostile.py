"""A hostile node beside a real robot of ROS 2: an action server and a service that describes types, which lie."""

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import zenoh

from linked_fleet_agent.robots.ros2.graph import Interface
from linked_fleet_agent.robots.ros2.transports import KEEP_LAST_ONE, RmwZenoh, Transport
from linked_fleet_agent.robots.ros2.types import GET_TYPE_DESCRIPTION, MessageTypes
from ros_peers import SOURCES

TYPES = MessageTypes([SOURCES / "interfaces_of_tests"], preferred="kilted")
NO_HASH, HEAD = f"RIHS01_{'0' * 64}", b"\x00\x01\x00\x00"
TRAP, RIDDLES, LIAR = "/trap", "/riddle", "/liar/get_type_description"
_FIBONACCI = "test_msgs/action/Fibonacci"
_CANCEL = "action_msgs/srv/CancelGoal"
_ACTION = TYPES.action(_FIBONACCI)
_DESCRIBING = TYPES.service(GET_TYPE_DESCRIPTION)
_FEEDBACK = Interface(f"{TRAP}/_action/feedback", _ACTION.feedback_message.name)
_NESTED = {"type_id": 1, "capacity": 0, "string_capacity": 0}


def _described(name: str, *fields: dict[str, Any], **others: list[dict[str, Any]]) -> bytes:
    referenced = [{"type_name": f"strange_msgs/msg/{each}", "fields": said} for each, said in others.items()]
    said = {"type_description": {"type_name": name, "fields": list(fields)}, "referenced_type_descriptions": referenced}
    return _DESCRIBING.response.write({"successful": True, "type_description": said})


def _field(type_id: int, nested: str = "", default: str = "", capacity: int = 0) -> dict[str, Any]:
    type_ = {"type_id": type_id, "capacity": capacity, "string_capacity": 0, "nested_type_name": nested}
    return {"name": "a", "type": type_, "default_value": default}


def _tower() -> bytes:
    floors = {f"A{n}": [_field(1, f"strange_msgs/msg/A{n + 1}")] for n in range(400)}
    return _described("strange_msgs/msg/Tower", _field(1, "strange_msgs/msg/A0"), **floors, A400=[_field(2)])


DESCRIPTIONS: dict[str, bytes | None] = {
    "Garbage": b"\xff" * 64,
    "Nothing": b"",
    "Items": HEAD + b"\x01\x00\x00\x00" * 2 + b"\xff" * 64,
    "Long": HEAD + bytes(3 * 2**20),
    "Another": _described("strange_msgs/msg/Elsewhere", _field(2)),
    "Itself": _described("strange_msgs/msg/Itself", _field(1, "strange_msgs/msg/Itself")),
    "Tower": _tower(),
    "Huge": _described(
        "strange_msgs/msg/Huge",
        _field(49, "strange_msgs/msg/B", capacity=65_536),
        B=[_field(51, capacity=65_536)],
    ),
    "Default": _described("strange_msgs/msg/Default", _field(6, default="__import__('os').abort()")),
    "Lie": _described("strange_msgs/msg/Lie", _field(2)),
    "Error": None,
    "Silence": None,
}
"""What the service says of the types ``strange_msgs/msg/NAME``. All of them have the hash ``NO_HASH``."""


class Liar:
    """The node. Close its session to end it."""

    def __init__(self, session: zenoh.Session, transport: Transport) -> None:
        self._session, self._transport = session, transport
        self._number, self._orders = 0, dict[bytes, int]()
        self._kept = list[Any]()
        self._asked = 0
        for name in DESCRIPTIONS:
            self._offer("publisher", Interface(f"{RIDDLES}/{name.lower()}", f"strange_msgs/msg/{name}"), NO_HASH)
        self._serve(Interface(LIAR, GET_TYPE_DESCRIPTION), self._describe)
        parts: dict[str, tuple[str, Callable[[zenoh.Query], None]]] = {
            "send_goal": (_ACTION.send_goal.name, self._send_goal),
            "get_result": (_ACTION.get_result.name, self._get_result),
            "cancel_goal": (_CANCEL, lambda query: self._reply(query, b"\xff" * 40)),
        }
        for part, (type_, answer) in parts.items():
            self._serve(Interface(f"{TRAP}/_action/{part}", type_), answer)
        self._offer("publisher", _FEEDBACK, TYPES.message(_FEEDBACK.type).hash)
        if not isinstance(transport, RmwZenoh):
            self._keep_token(f"AS/{TRAP[1:]}/{_FIBONACCI.replace('/', '§')}")

    def _serve(self, interface: Interface, answer: Callable[[zenoh.Query], None]) -> None:
        hash_ = TYPES.service(interface.type).hash
        key = self._transport.key(interface, hash_)
        self._kept.append(self._session.declare_queryable(key, answer, complete=True))
        self._offer("service", interface, hash_)

    def _offer(self, role: Any, interface: Interface, hash_: str) -> None:
        if isinstance(self._transport, RmwZenoh):
            self._number += 1
            token = self._transport.token(self._number, role, interface, hash_, KEEP_LAST_ONE)
            self._kept.append(self._session.liveliness().declare_token(token))
        elif "/_action/" not in interface.name:  # a bridge tells of whole actions
            name, type_ = interface.name[1:].replace("/", "§"), interface.type.replace("/", "§")
            kind, quality = ("MP", f"/:1:0::typehash={hash_};") if role == "publisher" else ("SS", "")
            self._keep_token(f"{kind}/{name}/{type_}{quality}")

    def _keep_token(self, of: str) -> None:
        token = f"@/{self._session.info.zid()}/@ros2_lv/{of}"
        self._kept.append(self._session.liveliness().declare_token(token))

    def _reply(self, query: zenoh.Query, payload: bytes) -> None:
        with suppress(zenoh.ZError), query:
            query.reply(query.key_expr, payload)

    def _describe(self, query: zenoh.Query) -> None:
        asked = _DESCRIBING.request.read(_payload(query))["type_name"].rpartition("/")[2]
        answer = DESCRIPTIONS.get(asked)
        if answer is not None:
            self._reply(query, answer)
        elif asked == "Error":
            with suppress(zenoh.ZError), query:
                query.reply_err(b"no")
        else:
            self._kept.append(query)

    def _send_goal(self, query: zenoh.Query) -> None:
        asked = _ACTION.send_goal.request.read(_payload(query))
        order, id = asked["goal"]["order"], bytes(asked["goal_id"]["uuid"])
        self._orders[id] = order
        accepted = _ACTION.send_goal.response.write({"accepted": True})
        if order == 1:
            self._reply(query, b"\xff" * 20)
        elif order == 2:
            self._reply(query, HEAD + bytes(2 * 2**20))
        elif order == 3:
            with suppress(zenoh.ZError), query:
                query.reply_err(b"no")
        elif order == 4:
            self._kept.append(query)
        else:
            self._reply(query, accepted)
        if order == 7:
            threading.Thread(target=self._tell_without_end, args=(id,), daemon=True).start()

    def _get_result(self, query: zenoh.Query) -> None:
        id = bytes(_ACTION.get_result.request.read(_payload(query))["goal_id"]["uuid"])
        order, self._asked = self._orders.get(id, 0), self._asked + 1
        if order == 5:
            nonsense = (b"\xff" * 20, HEAD + b"\x04\x00\x00\x00" + b"\xff" * 8, HEAD + bytes(2 * 2**20), b"")
            self._reply(query, nonsense[self._asked % len(nonsense)])
        elif order == 6:
            self._reply(query, _ACTION.get_result.response.write({"status": 77}))
        else:
            threading.Timer(3.0, self._reply, (query, self._end())).start()

    def _end(self) -> bytes:
        return _ACTION.get_result.response.write({"status": 4, "result": {"sequence": [7]}})

    def _tell_without_end(self, id: bytes) -> None:
        """Send feedback as fast as it goes for three seconds: of this goal, of goals that nobody has, and none."""
        key, ends_s = self._transport.key(_FEEDBACK, TYPES.message(_FEEDBACK.type).hash), time.monotonic() + 3.0
        good = [
            TYPES.message(_FEEDBACK.type).write({"goal_id": {"uuid": each}, "feedback": {"sequence": list(range(50))}})
            for each in (id, *(number.to_bytes(16) for number in range(200)))
        ]
        publisher = self._session.declare_publisher(key, congestion_control=zenoh.CongestionControl.DROP)
        while time.monotonic() < ends_s:
            for payload in (*good, b"\xff" * 64, HEAD + b"\xff" * 60_000):
                publisher.put(payload)
            time.sleep(0.01)
        publisher.undeclare()


def _payload(query: zenoh.Query) -> bytes:
    return query.payload.to_bytes() if query.payload is not None else b""
