"""The evaluation of a query has no side effects or network access, even without the refusal of SERVICE."""

import socket
import subprocess
import sys

import pytest

from running import ROOT

pytestmark = pytest.mark.processes
_PROGRAM = """
import sys
from pyoxigraph import Store
from linked_fleet_gateway.extensions.query.worker import limit
store = Store()
limit(5.0)
for silent in ("", "SILENT"):
    try:
        print(list(store.query("SELECT ?s { SERVICE %s <%s> { ?s ?p ?o } }" % (silent, sys.argv[1]))))
    except OSError as error:
        print(error.strerror)
try:
    open("/proc/self/environ")
except OSError as error:
    print(error.strerror)
"""


def test_a_query_reaches_no_other_server() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        address = f"http://127.0.0.1:{listener.getsockname()[1]}/"
        done = subprocess.run(
            [sys.executable, "-c", _PROGRAM, address], cwd=ROOT, capture_output=True, text=True, check=True
        )
        listener.setblocking(False)
        try:
            listener.accept()
            raise AssertionError("somebody came")
        except BlockingIOError:
            pass
    assert done.stdout.count("Too many open files") >= 1, done.stdout + done.stderr
    assert done.stdout.splitlines()[-1] == "Too many open files"
