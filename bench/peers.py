"""What other servers need for a GET, beside the same bare server: those that run already, named in PEERS.

``PEERS='zenohd=http://127.0.0.1:8000/demo/q solid=http://127.0.0.1:3055/bench/ttl'``; bench/README.md says how to get
them. Each is on this machine, and is asked for what it has at that URL.
"""

import os
import re
from pathlib import Path
from urllib.parse import urlsplit

import httpx

from bench.answers import wrk
from bench.beside import BARE, bare
from bench.table import Row, UnavailableError, known

_ACCEPT = {"accept": "text/turtle, application/json;q=0.9, */*;q=0.1"}
_LISTENING = "0A"


def rows(seconds: float) -> list[Row]:
    named = dict(each.split("=", 1) for each in os.environ.get("PEERS", "").split())
    if not named:
        raise UnavailableError("No other servers are named in PEERS (bench/README.md).")
    return [_of(name, url, seconds) for name, url in named.items()]


def _of(name: str, url: str, seconds: float) -> Row:
    size = len(httpx.get(url, headers=_ACCEPT).raise_for_status().content)
    with bare(size) as (beside, pid):
        constant = wrk(beside, pid, seconds).per_cpu_s
    found = wrk(url, listener(urlsplit(url).port or 80), seconds, _ACCEPT).per_cpu_s
    return known(f"GET of {name}, {size} bytes", "1/CPU s", found, f"{BARE}, {size} constant bytes", constant)


def listener(port: int) -> int:
    """The process that listens on a port of this machine."""
    sockets = set()
    for table in ("tcp", "tcp6"):
        for line in Path("/proc/net", table).read_text().splitlines()[1:]:
            address, _, state, *rest = line.split()[1:]
            if state == _LISTENING and int(address.rpartition(":")[2], 16) == port:
                sockets.add(f"socket:[{rest[5]}]")
    for path in Path("/proc").glob("[0-9]*/fd/*"):
        try:
            if str(path.readlink()) in sockets:
                return int(re.findall(r"\d+", str(path))[0])
        except OSError:  # it has ended, or is somebody else's
            continue
    raise UnavailableError(f"Nobody listens on port {port} whose processor time can be read.")
