"""The query process after its client is gone."""

import socket
import subprocess
import sys

import msgspec
import pytest

from linked_fleet_gateway.extensions.query.messages import News, QueryRequest, encode

pytestmark = pytest.mark.processes
ASK = QueryRequest(
    news=News(robots=[], frames={}), query="ASK {}", base="http://fleet", base_iri="http://fleet/query",
    patterns=("*",), caller="", default=None, named=None, branches=[], invocations=[], graphs=[],
    media_type="application/sparql-results+json", most_bytes=1000, limit_s=1.0,
)  # fmt: skip


@pytest.mark.parametrize("ask", [ASK, msgspec.structs.replace(ASK, query="this is no query")])
def test_the_worker_ends_silently_when_the_gateway_has_gone(ask: QueryRequest) -> None:
    ours, theirs = socket.socketpair()
    arguments = [sys.executable, "-m", "linked_fleet_gateway.extensions.query.worker", str(theirs.fileno())]
    with subprocess.Popen(arguments, pass_fds=[theirs.fileno()], stderr=subprocess.PIPE) as worker:
        theirs.close()
        waiting, answer = socket.socketpair()
        waiting.close()
        content = encode(ask)
        with ours, answer:
            socket.send_fds(ours, [len(content).to_bytes(8)], [answer.fileno()])
            ours.sendall(content)
        said = worker.stderr.read() if worker.stderr is not None else b""
    assert (worker.returncode, said) == (0, b"")


def test_the_worker_ends_silently_within_an_incomplete_message() -> None:
    ours, theirs = socket.socketpair()
    arguments = [sys.executable, "-m", "linked_fleet_gateway.extensions.query.worker", str(theirs.fileno())]
    with subprocess.Popen(arguments, pass_fds=[theirs.fileno()], stderr=subprocess.PIPE) as worker:
        theirs.close()
        with ours:
            ours.sendall((1000).to_bytes(8))
        said = worker.stderr.read() if worker.stderr is not None else b""
    assert (worker.returncode, said) == (0, b"")
