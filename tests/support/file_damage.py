"""Damage to the files of an embedded server, as caused by disks, crashes and people."""

import contextlib
import os
import re
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import redis

from linked_fleet_valkey import server as embedded
from running import eventually

Damage = Callable[[Path], object]
MANIFEST = "appendonly.aof.manifest"


def _increment(data: Path) -> Path:
    """Return the newest append-only file."""
    return max(data.glob("*.incr.aof"), key=lambda path: int(re.findall(r"\d+", path.name)[0]))


def _base(data: Path) -> Path:
    return max(data.glob("*.base.rdb"), key=lambda path: int(re.findall(r"\d+", path.name)[0]))


def _flip(path: Path, first: int, count: int) -> None:
    content = bytearray(path.read_bytes())
    for place in range(first, first + count):
        content[place] ^= 0xFF
    path.write_bytes(content)


def _append(path: Path, more: bytes) -> None:
    path.write_bytes(path.read_bytes() + more)


def cut_tail(data: Path) -> None:
    """Truncate the last command, as a crash in the middle of a write does."""
    _append(_increment(data), b"*3\r\n$3\r\nSET\r\n$4\r\nlost\r\n$9\r\nby ha")


def _flip_quarter(path: Path) -> None:
    """Damage several commands: fewer bytes could all be part of one value, which loads without an error."""
    size = path.stat().st_size
    _flip(path, size // 2, size // 4)


DAMAGES: dict[str, Damage] = {
    "bytes flipped in the middle": lambda data: _flip_quarter(_increment(data)),
    "zeros at the end": lambda data: _append(_increment(data), bytes(4096)),
    "an unknown command": lambda data: _append(_increment(data), b"*1\r\n$6\r\nNOSUCH\r\n"),
    "no file of commands": lambda data: _increment(data).unlink(),
    "a base of garbage": lambda data: _flip(_base(data), 0, 9),
    "a base that ends early": lambda data: os.truncate(_base(data), _base(data).stat().st_size - 9),
    "no base": lambda data: _base(data).unlink(),
    "a manifest of garbage": lambda data: (data / MANIFEST).write_text("nonsense\n"),
    "an empty manifest": lambda data: (data / MANIFEST).write_text(""),
    "no manifest": lambda data: (data / MANIFEST).unlink(),
}
"""Damage after which a server does not load its data."""


@contextlib.contextmanager
def _server(state_dir: Path) -> Iterator[redis.Redis]:
    """Yield a client of a server that is killed in the end."""
    state_dir.mkdir(parents=True, exist_ok=True)
    socket = state_dir / "valkey.sock"
    command = [embedded._program(), *embedded._configuration(state_dir, socket)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as server:
        eventually(socket.exists, "a server")
        with redis.Redis(unix_socket_path=str(socket)) as client:
            yield client
        server.kill()


def write_data(state_dir: Path) -> None:
    """Let a server write a base and an append-only file, as one that has run for long."""
    with _server(state_dir) as client:
        for number in range(100):
            client.set(f"key {number}", "x" * 50)
        client.bgrewriteaof()
        eventually(lambda: not _rewriting(client), "a base")
        for number in range(100):
            client.set(f"key {number}", "y" * 50)


def _rewriting(client: redis.Redis) -> bool:
    said = client.info("persistence")
    return bool(said["aof_rewrite_in_progress"] or said["aof_rewrite_scheduled"])


def garble(state_dir: Path, *, types: bool) -> list[bytes]:
    """Overwrite every key with data that the product never writes, of its own type or of another; return the keys."""
    with _server(state_dir) as client:
        keys = list(client.scan_iter())
        for key in keys:
            kind = client.type(key)
            if types:
                client.delete(key)
                client.hset(key, "a", "b") if kind == b"string" else client.set(key, "garbage")
            elif kind == b"string":
                client.set(key, b"\xffgarbage")
            elif kind == b"hash":
                client.hset(key, mapping=dict.fromkeys(client.hkeys(key), b"\xffgarbage"))
            elif kind == b"set":
                client.sadd(key, b"\xffgarbage")
            elif kind == b"zset":
                client.zadd(key, {b"\xffgarbage": 1})
            else:
                client.xadd(key, {b"\xff": b"\xffgarbage"})
        return keys
