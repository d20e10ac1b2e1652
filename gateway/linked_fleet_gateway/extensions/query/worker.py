"""The query process: ``python -m MODULE FD`` with this module, which the gateway starts for the first query.

It keeps a mirror of the fleet and never evaluates anything itself: each query gets a copy of the whole process, which
costs milliseconds, sees one instant, and may use up its time and memory, or crash, without anybody noticing.
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

from linked_fleet_gateway.extensions.query.evaluation import Seen, evaluate, warm
from linked_fleet_gateway.extensions.query.extended import decode_extended, extend
from linked_fleet_gateway.extensions.query.fleet_mirror import Mirror
from linked_fleet_gateway.extensions.query.functions import functions_of
from linked_fleet_gateway.extensions.query.messages import (
    DONE,
    FORKED,
    PATIENCE,
    REFUSED,
    Ask,
    Refused,
    decode_ask,
    encode,
)
from linked_fleet_gateway.extensions.query.rdf_mirror import SHAPES, Twin
from linked_fleet_gateway.identity.rights import View
from linked_fleet_gateway.rdf.graph import Graph
from linked_fleet_gateway.resources.describe import Describer
from linked_fleet_gateway.resources.documents import VOCABULARY
from linked_fleet_gateway.resources.fleet_functions import FUNCTIONS

log = logging.getLogger(__name__)

HEAD = struct.Struct("!Q")
MEMORY_BYTES = 512 * 2**20
"""Bytes that the evaluation of one query may add to the memory of the process."""
MAX_BASES = 2
"""Under how many base URLs the fleet is kept; under another it is written down anew."""


class Worker:
    """Answers queries one after another, each in a process of its own."""

    def __init__(self) -> None:
        self._mirror = Mirror()
        self._twins: OrderedDict[str, Twin] = OrderedDict()
        self._functions = [make() for make in FUNCTIONS]
        # What describes the fleet reads its shapes from files, which a query cannot.
        Describer("http://localhost").fleet({}, (), Graph())

    def serve(self, control: socket.socket) -> None:
        """Until the gateway is gone."""
        while (received := _receive(control)) is not None:
            content, answer = received
            with socket.socket(fileno=answer) as to:
                self._answer(decode_ask(content), to, control)

    def _answer(self, ask: Ask, to: socket.socket, control: socket.socket) -> None:
        self._mirror.take(ask.news)
        twin = self._twin(ask.base)
        twin.bring(self._mirror)
        for each in self._functions:
            if any(name.value.rpartition("#")[2] in ask.query for name in each.names):
                each.prepare()
        warm(ask.media_type)
        if os.fork() == 0:
            try:
                control.close()
                limit(ask.limit_s)
                to.sendall(FORKED)
                to.sendall(self._result(ask, twin))
            except ConnectionError:
                log.debug("nobody waits for the answer any more")
            except Exception:
                # The boundary of the copy: it must not go on as if it were the process that it is a copy of.
                log.exception("a query failed")
            finally:
                os._exit(0)

    def _twin(self, base: str) -> Twin:
        twin = self._twins.get(base) or Twin(base)
        self._twins[base] = twin
        self._twins.move_to_end(base)
        while len(self._twins) > MAX_BASES:
            self._twins.popitem(last=False)
        return twin

    def _result(self, ask: Ask, twin: Twin) -> bytes:
        sees = View(ask.patterns, ask.caller)
        robots = {name: held.robot for name, held in self._mirror.robots.items() if sees.sees(name)}
        if ask.instead:
            for each in ask.instead:
                self._mirror.suppose(each)
            twin.bring(self._mirror)
        try:
            seen = _complete(ask, twin, self._mirror, sees)
            functions = functions_of(ask.base, robots, ask.objects)
            for one in self._functions:
                functions |= one.bind(ask.base, robots)
            return evaluate(twin.store, ask, seen, functions) + DONE
        except Refused as refused:
            return encode(refused.refusal) + REFUSED


def _complete(ask: Ask, twin: Twin, mirror: Mirror, sees: View) -> Seen:
    """Add what depends on who asks, and say which graphs that is."""
    robots = {name: held.robot for name, held in sorted(mirror.robots.items()) if sees.sees(name)}
    graph = Graph()
    Describer(ask.base).fleet(robots, [(NamedNode(term), path) for term, path in ask.branches], graph)
    root = NamedNode(ask.base + "/")
    # What it says of its robots their own graphs say, and each thing is said once.
    twin.add("/", [triple for triple in graph.triples if triple.subject == root], "f")
    others = {each.id: each for held in robots for each in mirror.robots[held].invocations}
    for one in ask.invocations:
        twin.add("/", twin.invocation(one, others, sees.sees), "f" + one.id)
    for count, (path, content) in enumerate(ask.graphs):
        twin.add(path, [quad.triple for quad in parse(content, format=RdfFormat.N_TRIPLES)], f"c{count}x")
    more = {path for path, _ in ask.graphs} | {"/", VOCABULARY, SHAPES}
    names = {NamedNode(ask.base + path) for path in more} | {twin.graph_of(name) for name in robots}
    return Seen(sorted(names, key=lambda each: each.value), len(robots) == len(mirror.robots))


def limit(seconds: float) -> None:
    """From here on: so much time and memory, no file and no socket. The kernel ends it, whatever it is at."""
    signal.setitimer(signal.ITIMER_PROF, seconds)
    signal.setitimer(signal.ITIMER_REAL, seconds * PATIENCE)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + MEMORY_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    for each in (resource.RLIMIT_NOFILE, resource.RLIMIT_CORE):
        resource.setrlimit(each, (0, 0))


def _receive(control: socket.socket) -> tuple[bytes, int] | None:
    """A message and the socket that takes its answer; None when nothing comes any more."""
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
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the gateway, and that ends this
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody asks how a query ended; it has said so, or not
    if len(sys.argv) > 2:
        extend(decode_extended(sys.argv[2]))
    with socket.socket(fileno=int(sys.argv[1])) as control:
        Worker().serve(control)


if __name__ == "__main__":
    main()
