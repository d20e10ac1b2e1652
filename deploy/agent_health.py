"""Health check of an agent's container: exit code 0 while it has a TCP connection to one of its Zenoh endpoints."""

import os
import re
import sys
from pathlib import Path

_ESTABLISHED = "01"  # proc(5), /proc/net/tcp


def parse_ports(endpoints: str) -> set[int]:
    """Return the ports of endpoints such as ``tcp/router:7447,tcp/[::1]:7448``."""
    return {int(port) for port in re.findall(r":(\d+)(?:[#?,]|\s*$)", endpoints)}


def is_connected(tables: str, wanted: set[int]) -> bool:
    """Return True if /proc/net/tcp or tcp6 lists an established connection to a wanted port."""
    rows = (line.split() for line in tables.splitlines())
    remotes = (row[2] for row in rows if len(row) > 3 and row[3] == _ESTABLISHED)
    return any(int(remote.rpartition(":")[2], 16) in wanted for remote in remotes)


def main() -> int:
    files = (Path("/proc/net/tcp"), Path("/proc/net/tcp6"))  # the latter is missing without IPv6
    tables = "".join(file.read_text() for file in files if file.exists())
    return 0 if is_connected(tables, parse_ports(os.environ.get("LINKED_FLEET_ZENOH_CONNECT", ""))) else 1


if __name__ == "__main__":
    sys.exit(main())
