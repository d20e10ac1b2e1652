"""Runs a gateway whose event loop can be made to hang by a signal, for ten minutes or until SIGALRM.

SIGUSR1 hangs it in ``time.sleep``, SIGUSR2 in a regular expression, which keeps the interpreter lock.
"""

import re
import runpy
import signal
import time
from collections.abc import Callable

HANGS, GOES_ON = "the event loop hangs", "the event loop goes on"


class _GoOnError(Exception):
    """Ends a hang."""


def _go_on(*_: object) -> None:
    raise _GoOnError


def _hanging(call: Callable[[], object]) -> Callable[..., None]:
    def hang(*_: object) -> None:
        signal.signal(signal.SIGALRM, _go_on)
        signal.alarm(600)
        print(HANGS, flush=True)
        try:
            call()
        except _GoOnError:
            print(GOES_ON, flush=True)
        finally:
            signal.alarm(0)

    return hang


if __name__ == "__main__":
    signal.signal(signal.SIGUSR1, _hanging(lambda: time.sleep(601)))
    signal.signal(signal.SIGUSR2, _hanging(lambda: re.match("(a+)+$", "a" * 64 + "b")))
    runpy.run_module("linked_fleet_gateway", run_name="__main__", alter_sys=True)
