"""Runs Python in a network namespace of ``ip netns``. Arguments: NAME, then the arguments of Python."""

import contextlib
import ctypes
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO

_CLONE_NEWNET = 0x40000000


@contextlib.contextmanager
def entered(name: str) -> Iterator[None]:
    """Keep the calling thread, and threads and processes that it starts meanwhile, in the namespace ``name``.

    A change of the machine's own interfaces makes each Chromium on it end its requests (ERR_NETWORK_CHANGED), also
    those of tests that run at the same time.
    """
    with Path("/proc/thread-self/ns/net").open() as before:
        with Path("/run/netns", name).open() as namespace:
            _enter(namespace)
        try:
            yield
        finally:
            _enter(before)


def _enter(namespace: TextIO) -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.setns(namespace.fileno(), _CLONE_NEWNET):
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()), namespace.name)


def main(name: str, *arguments: str) -> None:
    with entered(name):
        os.execv(sys.executable, (sys.executable, "-u", "-X", "faulthandler", *arguments))


if __name__ == "__main__":
    main(*sys.argv[1:])
