"""Other servers beside the gateway: GETs, and messages to many subscribers.

``PEERS_DIR`` is the folder, here FOLDER, in which they were built. Missing ones are left out.

- ``target/release/zenohd``, Zenoh's router with its plugins for REST and WebSockets: unpack the crates ``zenohd``,
  ``zenoh-plugin-rest`` and ``zenoh-plugin-remote-api`` of one version side by side, make them one workspace with the
  ``Cargo.lock`` of zenohd, and run ``CARGO_TARGET_DIR=FOLDER/target cargo build --release``.
- ``css/node_modules/@solid/community-server``, the Community Solid Server:
  ``npm install --prefix FOLDER/css @solid/community-server``.
- ``wot/node_modules/@node-wot/core``, node-wot:
  ``npm install --prefix FOLDER/wot @node-wot/core @node-wot/binding-http``.
"""

import contextlib
import os
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import httpx
import zenoh

from bench.answers import wrk
from bench.beside import BARE, bare
from bench.fan_out import Case, fan_out, measured
from bench.references import Beat, session
from bench.scene import Readers
from bench.table import Row, UnavailableError, at_least, known
from running import eventually, free_port

_SIZE = 1216  # bytes, like a value of the gateway in Turtle
_ACCEPT = {"accept": "text/turtle, application/json;q=0.9, */*;q=0.1"}
_HERE = Path(__file__).with_name("others")
_KEY = "bench/value"
_TEXT = b'<> <lf:version> "1" . <> <vom:numericalValue> "0" .'  # what ``bench/readers.py`` counts
_CASES = (Case("sse", 500, 200), Case("ws", 500, 200))
_AHEAD = 2.5
_START_S = 180.0  # the Solid server takes twenty seconds on an idle machine


class Peer(NamedTuple):
    """A running server: the URL for GETs, and its process."""

    url: str
    pid: int


def rows(seconds: float) -> list[Row]:
    folder = Path(os.environ.get("PEERS_DIR", ""))
    starts = {
        name: start
        for name, (start, part) in _PEERS.items()
        if os.environ.get("PEERS_DIR") and (folder / part).exists()
    }
    if not starts:
        raise UnavailableError("No other servers are in PEERS_DIR (bench/peers.py).")
    found = [row for name, start in starts.items() for row in _get(name, start, folder, seconds)]
    return [*found, *(_fan_out(folder, seconds) if "zenohd" in starts else ())]


def _get(name: str, start: "_Start", folder: Path, seconds: float) -> Iterator[Row]:
    with start(folder) as peer:
        size = len(httpx.get(peer.url, headers=_ACCEPT).raise_for_status().content)
        with bare(size) as (beside, pid):
            constant = wrk(beside, pid, seconds).per_cpu_s
        found = wrk(peer.url, peer.pid, seconds, _ACCEPT).per_cpu_s
    yield known(f"GET of {name}, {size} bytes", "1/CPU s", found, f"{BARE}, {size} constant bytes", constant)


def _fan_out(folder: Path, seconds: float) -> Iterator[Row]:
    """Measure messages per second of processor time, of the router and of the gateway, to subscribers of one value."""
    payload = _TEXT.ljust(_SIZE)
    for case in _CASES:
        with _router(folder) as router, contextlib.closing(session("client", connect=router.zenoh)) as publisher:
            beat = Beat(case.rate_hz, lambda: publisher.put(_KEY, payload, encoding=zenoh.Encoding.TEXT_PLAIN))
            with contextlib.closing(beat):
                port, how = (router.rest, "sse") if case.how == "sse" else (router.remote, "zenoh")
                with contextlib.closing(Readers(port, how, case.count, f"/{_KEY}")) as readers:
                    time.sleep(0.5)
                    theirs = measured(router.pid, readers, seconds)
        ours = fan_out(case, seconds)
        yield at_least(
            f"messages to {case.name}", "1/CPU s", ours.per_cpu_s, "Zenoh's router", theirs.per_cpu_s, _AHEAD
        )


# -- the servers ------------------------------------------------------------------------------------------------------


class _Router(NamedTuple):
    pid: int
    zenoh: str
    rest: int
    remote: int


@contextlib.contextmanager
def _running(*command: str, ready: str) -> Iterator[int]:
    """Run a child that answers at ``ready`` (an HTTP URL); yield its process id."""
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as child:  # noqa: S603
        try:
            _await(ready, child)
            yield child.pid
        finally:
            child.kill()


def _await(url: str, child: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + _START_S
    while True:
        try:
            httpx.get(url)
            return
        except httpx.TransportError:
            if child.poll() is not None or time.monotonic() > deadline:
                raise UnavailableError(f"{child.args!r} does not answer at {url}.") from None
            time.sleep(0.1)


@contextlib.contextmanager
def _router(folder: Path) -> Iterator[_Router]:
    built = folder / "target/release"
    link, rest, remote = f"tcp/127.0.0.1:{free_port()}", free_port(), free_port()
    command = (
        *(str(built / "zenohd"), "-l", link, "--no-multicast-scouting", "--plugin-search-dir", str(built)),
        *("--rest-http-port", f"127.0.0.1:{rest}", "--cfg", "scouting/gossip/enabled:false"),
        *("-P", "remote_api", "--cfg", f'plugins/remote_api/websocket_port:"127.0.0.1:{remote}"'),
    )
    with _running(*command, ready=f"http://127.0.0.1:{rest}/@/local/router") as pid:
        yield _Router(pid, link, rest, remote)


@contextlib.contextmanager
def _zenohd(folder: Path) -> Iterator[Peer]:
    """Run zenohd with its REST plugin, which queries a session for each response."""
    turtle = _TEXT.ljust(_SIZE)
    with _router(folder) as router, contextlib.closing(session("client", connect=router.zenoh)) as answering:
        answering.declare_queryable(
            _KEY, lambda query: query.reply(_KEY, turtle, encoding=zenoh.Encoding("text/turtle"))
        )
        url = f"http://127.0.0.1:{router.rest}/{_KEY}?_raw"
        eventually(lambda: httpx.get(url).content == turtle, "the router finds who answers")
        yield Peer(url, router.pid)


@contextlib.contextmanager
def _solid(folder: Path) -> Iterator[Peer]:
    """Run the Community Solid Server in memory, with public access."""
    port = free_port()
    root, server = f"http://127.0.0.1:{port}/", folder / "css/node_modules/@solid/community-server/bin/server.js"
    command = (*_node("-r", str(_HERE / "loopback.cjs"), str(server)), "-p", str(port), "-b", root, "-l", "error")
    with _running(*command, ready=root) as pid:
        url = f"{root}bench/value"
        httpx.put(url, content=_TEXT.ljust(_SIZE), headers={"content-type": "text/turtle"}).raise_for_status()
        yield Peer(url, pid)


@contextlib.contextmanager
def _wot(folder: Path) -> Iterator[Peer]:
    port = free_port()
    root = f"http://127.0.0.1:{port}/"
    with _running(*_node(str(_HERE / "wot.cjs"), str(folder / "wot"), str(port)), ready=root) as pid:
        yield Peer(f"{root}probe/properties/temperature", pid)


def _node(*arguments: str) -> tuple[str, ...]:
    node = shutil.which("node")
    if node is None:
        raise UnavailableError("Node.js is not here, by which other servers run.")
    return (node, *arguments)


_Start = Callable[[Path], contextlib.AbstractContextManager[Peer]]
_PEERS: dict[str, tuple[_Start, str]] = {
    "zenohd": (_zenohd, "target/release/zenohd"),
    "Community Solid Server": (_solid, "css/node_modules/@solid/community-server"),
    "node-wot": (_wot, "wot/node_modules/@node-wot/core"),
}
