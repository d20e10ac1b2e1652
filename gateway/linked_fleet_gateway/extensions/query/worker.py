"""The query process, ``python -m MODULE FD``, which the gateway starts for the first query.

It keeps a mirror of the fleet and evaluates nothing itself: it forks for each query. A fork costs milliseconds, has a
consistent snapshot, and may exceed its limits or crash without affecting others.
"""

import logging
import os
import resource
import signal
import socket
import struct
import sys
from collections import OrderedDict
from pathlib import Path

from pyoxigraph import NamedNode, RdfFormat, parse

from linked_fleet_base.contributions import set_present
from linked_fleet_base.errors import LibraryMissing
from linked_fleet_gateway.extensions.query.evaluation import VisibleGraphs, evaluate, preload
from linked_fleet_gateway.extensions.query.fleet_mirror import Mirror
from linked_fleet_gateway.extensions.query.functions import functions_of
from linked_fleet_gateway.extensions.query.messages import (
    DONE,
    FORKED,
    PATIENCE,
    REFUSED,
    QueryRequest,
    Refusal,
    Refused,
    decode_ask,
    decode_contributions,
    encode,
)
from linked_fleet_gateway.extensions.query.rdf_mirror import SHAPES, RdfMirror
from linked_fleet_gateway.faces import VOCABULARY, Describer, View, run_steps
from linked_fleet_rdf.graph import Graph
from linked_fleet_state.functions import added_functions

log = logging.getLogger(__name__)

HEAD = struct.Struct("!Q")
MEMORY_BYTES = 512 * 2**20
"""Memory in bytes that the evaluation of one query may add."""
MAX_BASES = 2
"""Number of base URLs for which the fleet is kept; for another one it is written again."""


class Worker:
    """Answers queries one after another, each in a forked process."""

    def __init__(self) -> None:
        self._mirror = Mirror()
        self._rdf_mirrors: OrderedDict[str, RdfMirror] = OrderedDict()
        self._functions = [make() for make in added_functions()]
        # Loads the shapes now, because a query cannot open files.
        run_steps(Describer("http://localhost").fleet({}, (), Graph()))

    def serve(self, control: socket.socket) -> None:
        """Serve until the gateway is gone."""
        while (received := _receive(control)) is not None:
            content, answer = received
            with socket.socket(fileno=answer) as to:
                self._answer(decode_ask(content), to, control)

    def _answer(self, ask: QueryRequest, to: socket.socket, control: socket.socket) -> None:
        self._mirror.update(ask.news)
        rdf_mirror = self._rdf_mirror(ask.base)
        rdf_mirror.update(self._mirror)
        try:
            for each in self._functions:
                if any(name.value.rpartition("#")[2] in ask.query for name in each.names):
                    each.prepare()
        except LibraryMissing as error:
            to.sendall(FORKED + encode(Refusal(reason="missing", detail=error.detail)) + REFUSED)
            return
        preload(ask.media_type)
        if os.fork() == 0:
            try:
                control.close()
                limit(ask.limit_s)
                to.sendall(FORKED)
                to.sendall(self._result(ask, rdf_mirror))
            except ConnectionError:
                log.debug("the client of the query has disconnected")
            except Exception:
                # The boundary of the fork: it must not continue as if it were its parent.
                log.exception("a query failed")
            finally:
                os._exit(0)

    def _rdf_mirror(self, base: str) -> RdfMirror:
        rdf_mirror = self._rdf_mirrors.get(base) or RdfMirror(base)
        self._rdf_mirrors[base] = rdf_mirror
        self._rdf_mirrors.move_to_end(base)
        while len(self._rdf_mirrors) > MAX_BASES:
            self._rdf_mirrors.popitem(last=False)
        return rdf_mirror

    def _result(self, ask: QueryRequest, rdf_mirror: RdfMirror) -> bytes:
        sees = View(ask.patterns, ask.caller)
        robots = {name: held.robot for name, held in self._mirror.robots.items() if sees.includes(name)}
        if ask.hypothetical_robots:
            for each in ask.hypothetical_robots:
                self._mirror.assume(each)
            rdf_mirror.update(self._mirror)
        try:
            seen = _complete(ask, rdf_mirror, self._mirror, sees)
            functions = functions_of(ask.base, robots, {**ask.poses, **ask.carried})
            for one in self._functions:
                functions |= one.bind(ask.base, robots)
            return evaluate(rdf_mirror.store, ask, seen, functions) + DONE
        except Refused as refused:
            return encode(refused.refusal) + REFUSED


def _complete(ask: QueryRequest, rdf_mirror: RdfMirror, mirror: Mirror, sees: View) -> VisibleGraphs:
    """Add the statements that depend on the caller. Return the visible graphs."""
    robots = {name: held.robot for name, held in sorted(mirror.robots.items()) if sees.includes(name)}
    graph = Graph()
    run_steps(Describer(ask.base).fleet(robots, [(NamedNode(term), path) for term, path in ask.branches], graph))
    root = NamedNode(ask.base + "/")
    # Statements about robots are in the graphs of the robots, so they are left out here.
    rdf_mirror.add("/", [triple for triple in graph.triples if triple.subject == root], "f")
    others = {each.id: each for held in robots for each in mirror.robots[held].invocations}
    for one in ask.invocations:
        rdf_mirror.add("/", rdf_mirror.invocation(one, others, sees.includes), "f" + one.id)
    for count, (path, content) in enumerate(ask.graphs):
        rdf_mirror.add(path, [quad.triple for quad in parse(content, format=RdfFormat.N_TRIPLES)], f"c{count}x")
    more = {path for path, _ in ask.graphs} | {"/", VOCABULARY, SHAPES}
    names = {NamedNode(ask.base + path) for path in more} | {rdf_mirror.graph_of(name) for name in robots}
    return VisibleGraphs(sorted(names, key=lambda each: each.value), len(robots) == len(mirror.robots))


def limit(seconds: float) -> None:
    """Limit time and memory from now on, and forbid files and sockets. The kernel enforces it."""
    signal.setitimer(signal.ITIMER_PROF, seconds)
    signal.setitimer(signal.ITIMER_REAL, seconds * PATIENCE)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + MEMORY_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    for each in (resource.RLIMIT_NOFILE, resource.RLIMIT_CORE):
        resource.setrlimit(each, (0, 0))


def _receive(control: socket.socket) -> tuple[bytes, int] | None:
    """Receive a message and the socket for its answer; None at the end of the connection."""
    try:
        head, descriptors, _, _ = socket.recv_fds(control, HEAD.size, 1)
        if len(head) < HEAD.size or not descriptors:
            return None
        (size,) = HEAD.unpack(head)
        content = bytearray(size)
        view = memoryview(content)
        while view:
            count = control.recv_into(view)
            if not count:
                return None
            view = view[count:]
    except ConnectionError:  # the gateway was killed
        return None
    return bytes(content), descriptors[0]


def main() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the gateway, which then ends this process
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # the exit status of a query is not collected
    if len(sys.argv) > 2:
        set_present(decode_contributions(sys.argv[2]))
    with socket.socket(fileno=int(sys.argv[1])) as control:
        Worker().serve(control)


if __name__ == "__main__":
    main()
