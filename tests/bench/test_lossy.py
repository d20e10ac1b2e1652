"""The network with delay and loss: what arrives through it, and that it is removed completely."""

import os
import socket
import subprocess
import sys

import pytest

from bench.lossy import lossy
from bench.namespaces import full_name, namespaces
from bench.table import UnavailableError
from in_namespace import entered

pytestmark = [pytest.mark.processes, pytest.mark.test_all]

COUNT = 400
_SEND = """import socket, sys
link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
for number in range(int(sys.argv[3])):
    link.sendto(number.to_bytes(4), (sys.argv[1], int(sys.argv[2])))
"""


def arrived(loss: float) -> list[int]:
    """Return the numbers of the packets that arrived from the far end."""
    try:
        with (
            namespaces(),
            entered(full_name("hub")),
            lossy(1.0, loss) as network,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as here,
        ):
            here.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
            here.bind((network.here, 0))
            here.settimeout(0.5)
            flags = network.python("-c", _SEND, network.here, str(here.getsockname()[1]), str(COUNT))
            subprocess.run((sys.executable, *flags), check=True)
            found = []
            try:
                while True:
                    found.append(int.from_bytes(here.recv(4)))
            except TimeoutError:
                return found
    except UnavailableError as reason:
        pytest.skip(str(reason))


def test_without_loss_all_arrive_in_order() -> None:
    assert arrived(0.0) == list(range(COUNT))


def test_with_loss_some_messages_are_missing() -> None:
    found = arrived(0.1)
    assert sorted(set(range(COUNT)) - set(found))
    assert len(found) > COUNT * 0.8
    names = subprocess.run(("ip", "netns"), capture_output=True, text=True, check=True).stdout
    assert f"lb{os.getpid()}" not in names
