"""A folder for the state of gateways that are given none."""

import atexit
import functools
import shutil
import tempfile


@functools.cache
def state_home() -> str:
    """Return the default folder for the state of processes, which are kept out of the user's own folders."""
    home = tempfile.mkdtemp(prefix="linked-fleet-")
    atexit.register(shutil.rmtree, home, ignore_errors=True)
    return home
