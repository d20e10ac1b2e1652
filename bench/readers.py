"""Many subscribers in one light process that only counts messages.

``python readers.py PORT ws|sse|zenoh COUNT PATH,…`` subscribes to all paths in turn, and prints ``ready`` when each
subscriber has its first message. It answers each line on standard input with one line of JSON about the messages since
the last line.
"""

import json
import re
import resource
import select
import socket
import sys
import time
from dataclasses import dataclass, field
from typing import Any

MESSAGE = b"lf:version"  # once in each message, whatever the framing
_VALUE = re.compile(rb'numericalValue "([^"]+)"')
SAMPLED = 20
"""Number of subscribers, spread evenly, whose latency is measured."""
KEY = b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n"
ASKS = {
    "zenoh": b"Connection: Upgrade\r\nUpgrade: websocket\r\n" + KEY,
    "ws": b"Connection: Upgrade\r\nUpgrade: websocket\r\n" + KEY,
    "sse": b"Accept: text/event-stream\r\n",
}


_NEWLINE = ord("\n")
_ROOM = bytearray(1 << 18)  # a reused buffer: allocating one for each read costs more than reading
_VIEW = memoryview(_ROOM)


@dataclass
class Reader:
    sock: socket.socket
    sampled: bool
    messages: int = 0
    rest: bytes = b""
    seen: list[tuple[int, float]] = field(default_factory=list)
    """Times (CLOCK_MONOTONIC, ns) and values received."""

    def read(self) -> int:
        kept = len(self.rest)
        _ROOM[:kept] = self.rest
        size = self.sock.recv_into(_VIEW[kept:])
        if not size:
            raise ConnectionError("the gateway closed a connection")
        end = kept + size
        self.messages += _ROOM.count(MESSAGE, 0, end)
        # The kept rest is shorter than what is counted, so that nothing is counted twice.
        self.rest = b"" if _ROOM[end - 1] == _NEWLINE else bytes(_VIEW[max(0, end + 1 - len(MESSAGE)) : end])
        if self.sampled:
            now_ns = time.monotonic_ns()
            self.seen += [(now_ns, float(value)) for value in _VALUE.findall(_VIEW[:end])]
        return size


def opened(port: int, ask: bytes, path: str, sampled: bool) -> Reader:
    sock = socket.create_connection(("127.0.0.1", port))
    sock.sendall(b"GET %b HTTP/1.1\r\nHost: 127.0.0.1:%d\r\n%b\r\n" % (path.encode(), port, ask))
    return Reader(sock, sampled)


def subscribe(sock: socket.socket, key: bytes) -> None:
    """Subscribe to a key by Zenoh's remote API: open a session, and a subscriber in it."""
    while not sock.recv(1 << 16).endswith(b"\r\n\r\n"):
        pass
    for message in (b"\x99" + bytes(4), b"\x82\x01" + bytes(7) + bytes([len(key)]) + key + b"\x02"):
        sock.sendall(bytes([0x82, 0x80 | len(message)]) + bytes(4) + message)  # masked with zeros


class Crowd:
    def __init__(self, port: int, how: str, count: int, paths: list[str]) -> None:
        every = max(1, count // SAMPLED)
        self.readers = [
            opened(port, ASKS[how], paths[number % len(paths)], number % every == 0) for number in range(count)
        ]
        if how == "zenoh":
            for reader in self.readers:
                subscribe(reader.sock, paths[0][1:].encode())
        self.bytes = 0
        self._of = {reader.sock.fileno(): reader for reader in self.readers}
        self._epoll = select.epoll()
        for number in (*self._of, sys.stdin.fileno()):
            self._epoll.register(number, select.EPOLLIN)

    def turn(self) -> bool:
        """Read what has arrived; return True if standard input has a line."""
        asked = False
        for number, _ in self._epoll.poll():
            reader = self._of.get(number)
            if reader is None:
                asked = True
            else:
                self.bytes += reader.read()
        return asked

    def answer(self) -> dict[str, Any]:
        usage = resource.getrusage(resource.RUSAGE_SELF)
        found = {
            "at_ns": time.monotonic_ns(),
            "messages": sum(reader.messages for reader in self.readers),
            "bytes": self.bytes,
            "cpu_s": usage.ru_utime + usage.ru_stime,
            "seen": [reader.seen for reader in self.readers if reader.sampled],
        }
        self.bytes = 0
        for reader in self.readers:
            reader.messages, reader.seen = 0, []
        return found


def main() -> None:
    port, how, count, paths = int(sys.argv[1]), sys.argv[2], int(sys.argv[3]), sys.argv[4].split(",")
    crowd = Crowd(port, how, count, paths)
    while not all(reader.messages for reader in crowd.readers):
        crowd.turn()
    print("ready", flush=True)
    while True:
        if crowd.turn():
            if not sys.stdin.readline():
                return
            print(json.dumps(crowd.answer()), flush=True)


if __name__ == "__main__":
    main()
