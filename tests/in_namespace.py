"""Runs Python in a network namespace of ``ip netns``. Arguments: NAME, then the arguments of Python."""

import ctypes
import os
import sys
from pathlib import Path

_CLONE_NEWNET = 0x40000000


def main(name: str, *arguments: str) -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    with Path("/run/netns", name).open() as namespace:
        if libc.setns(namespace.fileno(), _CLONE_NEWNET):
            raise OSError(ctypes.get_errno(), f"namespace {name}: {os.strerror(ctypes.get_errno())}")
    os.execv(sys.executable, (sys.executable, "-u", "-X", "faulthandler", *arguments))


if __name__ == "__main__":
    main(*sys.argv[1:])
