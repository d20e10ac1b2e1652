"""A client of the protocol of Foxglove for tests: over sockets, or in memory on virtual time."""

import json
import struct
from base64 import b64decode
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, Self

from connections import WebSocket, websocket
from foxglove_messages import decoded
from linked_fleet_gateway.extensions.foxglove.protocol import SUBPROTOCOLS


@dataclass
class Client:
    """A client of the protocol that keeps all received messages."""

    socket: WebSocket
    heard: list[dict[str, Any]] = field(default_factory=list)
    channels: dict[str, dict[str, Any]] = field(default_factory=dict)
    services: dict[str, dict[str, Any]] = field(default_factory=dict)
    data: list[tuple[int, int, bytes]] = field(default_factory=list)
    responses: list[tuple[int, Any]] = field(default_factory=list)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.socket.close()

    def take(self) -> None:
        message = self.socket.recv()
        if isinstance(message, bytes):
            if message[0] == 1:
                _, id, stamp = struct.unpack_from("<BIQ", message)
                self.data.append((id, stamp, message[13:]))
            else:
                op, _, call, length = struct.unpack_from("<BIII", message)
                assert (op, message[13 : 13 + length]) == (3, b"json")
                self.responses.append((call, json.loads(message[13 + length :])))
            return
        said = json.loads(message)
        self.heard.append(said)
        self.channels |= {each["topic"]: each for each in said.get("channels", ())}
        self.services |= {each["name"]: each for each in said.get("services", ())}
        self.channels = {k: v for k, v in self.channels.items() if v["id"] not in said.get("channelIds", ())}

    def until(self, condition: Any) -> Any:
        while not (found := condition()):
            self.take()
        return found

    def next(self, op: str) -> dict[str, Any]:
        """The next message of this kind, which is taken out."""
        found = self.until(lambda: next((each for each in self.heard if each["op"] == op), None))
        self.heard.remove(found)
        return dict(found)

    def send(self, op: str, **said: Any) -> None:
        self.socket.send(json.dumps({"op": op, **said}))

    def subscribe(self, *topics: str) -> None:
        wanted = [
            {"id": id, "channelId": self.until(lambda t=t: self.channels.get(t))["id"]} for id, t in enumerate(topics)
        ]
        self.send("subscribe", subscriptions=wanted)

    def json_message(self, id: int) -> Any:
        """The next message of a subscription whose channel has JSON."""
        found = self._first(id)
        self.data.remove(found)
        return json.loads(found[2])

    def message(self, id: int, topic: str) -> Any:
        """A message of a subscription: the first one that has not been asked for."""
        content = self._first(id)[2]
        self.data = [each for each in self.data if each[0] != id]
        channel = self.channels[topic]
        assert (channel["encoding"], channel["schemaEncoding"]) == ("protobuf", "protobuf")
        return decoded(channel["schemaName"], b64decode(channel["schema"]), content)

    def _first(self, id: int) -> Any:
        return self.until(lambda: next((each for each in self.data if each[0] == id), None))

    def call(self, name: str, content: bytes = b"{}", id: int = 7, encoding: bytes = b"json") -> None:
        service = self.until(lambda: self.services.get(name))["id"]
        self.socket.send(struct.pack("<BIII", 2, service, id, len(encoding)) + encoding + content)


def connected(root: str, token: str = "", subprotocol: str = SUBPROTOCOLS[0]) -> Client:
    fields = {"authorization": f"Bearer {token}"} if token else {}
    return Client(websocket(f"{root}foxglove", fields, subprotocol))
