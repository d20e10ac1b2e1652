"""RDF stores and parsers for the graphs of the client; ``python -m bench.client_graphs``.

All documents differ, as those of a user do. Times are medians of this thread's processor time.
"""

import argparse
import contextlib
import gc
import io
import os
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from unittest.mock import patch

import pyshacl
from rdflib import RDF, SH, Graph, URIRef

from linked_fleet_client.conform import command
from linked_fleet_client.fleet import Fleet
from linked_fleet_client.graphs import copy_in_memory, load_big, load_exactly
from linked_fleet_client.reading import read
from linked_fleet_client.shape import read_shape

HEAD = """@prefix dcterms: <http://purl.org/dc/terms/> . @prefix hybrit: <https://hybr-it-projekt.de/ns/hybr-it#> .
@prefix ldp: <http://www.w3.org/ns/ldp#> . @prefix sh: <http://www.w3.org/ns/shacl#> .
@prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> . @prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
@prefix unit: <http://qudt.org/vocab/unit/> . @prefix lf: <https://w3id.org/linked-fleet#> .
"""
BASE = "http://127.0.0.1/"
SIZES = {"a value": 1, "a joint": 6, "a robot": 60, "a big description": 2000}
Loader = Callable[[str, str, str], Graph]


def with_rdflib(text: str, syntax: str, base: str) -> Graph:
    return Graph().parse(data=text, format=syntax, publicID=base)


LOADERS: dict[str, Loader] = {
    "rdflib": with_rdflib,
    "Oxigraph's parser, rdflib's store": load_exactly,
    "Oxigraph's parser and store": load_big,
}


def description(properties: int, number: int) -> str:
    """Return a thing with so many properties, each with a value and a unit (six triples)."""
    return HEAD + "".join(
        f'<> hybrit:property <#p{index}> . <#p{index}> a hybrit:Property ; dcterms:title "p{index} of {number}" ; '
        f'lf:value [ vom:numericalValue "{index + number}.25"^^xsd:double ; vom:unit unit:RAD ] .\n'
        for index in range(properties)
    )


def shape(choices: int, number: int) -> str:
    """Return the shape of an action of so many joints, each with its range."""
    return (
        HEAD
        + "<#s> a sh:NodeShape ; sh:or ( "
        + " ".join(
            f"[ sh:property [ sh:path lf:joint ; sh:hasValue <#j{index}> ; sh:minCount 1 ], [ sh:path lf:value ; "
            f"sh:datatype xsd:decimal ; sh:minInclusive -{index}.5 ; sh:maxInclusive {index + number}.5 ] ]"
            for index in range(choices)
        )
        + " ) ."
    )


def median_ms(work: Callable[[int], object], times: int) -> float:
    """Return the median processor time, without the first call."""
    work(0)
    found = []
    for number in range(1, times + 1):
        begun = time.thread_time()
        work(number)
        found.append((time.thread_time() - begun) * 1e3)
    return statistics.median(found)


def rows() -> Iterator[tuple[str, list[float]]]:
    """Yield a name and one figure per loader."""
    for name, size in SIZES.items():
        times = max(5, 300 // size)
        texts = [description(size, number) for number in range(times + 1)]
        count = len(with_rdflib(texts[0], "turtle", BASE))
        graphs = {key: [loader(text, "turtle", BASE) for text in texts] for key, loader in LOADERS.items()}
        yield (
            f"parse {name} ({count} triples), ms",
            [
                median_ms(lambda number, to=loader, of=texts: to(of[number], "turtle", BASE), times)
                for loader in LOADERS.values()
            ],
        )
        yield (
            "read all its values once, ms",
            [median_ms(lambda number, of=graphs[key]: values(of[number]), times) for key in LOADERS],
        )
    shapes = {
        key: [loader(shape(15, number), "turtle", BASE) for number in range(21)] for key, loader in LOADERS.items()
    }
    yield (
        "read the shape of an action, ms",
        [median_ms(lambda number, of=shapes[key]: read_shape(of[number], URIRef(f"{BASE}#s")), 20) for key in LOADERS],
    )
    yield (
        "the same from a copy in memory, with the copying, ms",
        [
            median_ms(lambda number, of=shapes[key]: read_shape(copy_in_memory(of[number]), URIRef(f"{BASE}#s")), 20)
            for key in LOADERS
        ],
    )
    yield "pySHACL on it, ms", [median_ms(lambda number, of=shapes[key]: judged(of[number]), 10) for key in LOADERS]
    yield "a walk of a tree of 61 resources by the client, ms", [walk(loader) for loader in LOADERS.values()]
    yield "a conform run on it in-process, ms", [conform(loader) for loader in LOADERS.values()]
    yield "memory of 512 joints kept, MB", [memory(key) for key in LOADERS]


def values(graph: Graph) -> int:
    return sum(len(read(graph, subject).values) for subject in graph.subjects(RDF.type, None))


def judged(shapes: Graph) -> object:
    body = with_rdflib(f"{HEAD} <#b> lf:joint <#j7> ; lf:value 1.5 .", "turtle", BASE)
    shapes.add((URIRef(f"{BASE}#s"), SH.targetNode, URIRef(f"{BASE}#b")))
    return pyshacl.validate(body, shacl_graph=shapes, inference="none")[0]


class _Tree(BaseHTTPRequestHandler):
    """Serves a root with twenty robots of two joints, which change with each response."""

    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True
    answers = 0

    def do_GET(self) -> None:
        _Tree.answers += 1
        depth = self.path.count("/")
        below = {1: [f"/r{index}/" for index in range(20)], 2: [f"{self.path}j1", f"{self.path}j2"]}
        leads = below[1] if self.path == "/" else [] if "j" in self.path else below[2]
        text = (
            description(6 if depth > 1 else 1, _Tree.answers)
            + "<> a hybrit:RoboticThing . "
            + "".join(f"<> dcterms:hasPart <{path}> . <{path}> a hybrit:RoboticThing . " for path in leads)
        )
        self._answer(200, text.encode())

    def do_OPTIONS(self) -> None:
        self._answer(200, b"")

    def do_HEAD(self) -> None:
        self.do_GET()

    def _answer(self, status: int, body: bytes) -> None:
        self.send_response(status)
        for name, value in (("allow", "GET, HEAD, OPTIONS"), ("content-type", "text/turtle"),
                            ("content-length", str(len(body))), ("etag", f'"{_Tree.answers}"')):  # fmt: skip
            self.send_header(name, value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def log_message(self, format: str, *args: object) -> None:
        """Log nothing."""


@contextlib.contextmanager
def tree() -> Iterator[str]:
    with ThreadingHTTPServer(("127.0.0.1", 0), _Tree) as server:
        server.daemon_threads = True
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_address[1]}/"
        finally:
            server.shutdown()
            thread.join()


def walk(loader: Loader) -> float:
    """Walk the tree and read the values of each resource, with a new client each time."""

    def once(_: int) -> None:
        with Fleet(root) as fleet:
            for thing in fleet.walk():
                for prop in thing.properties_in(thing.document()):
                    prop.reading_in(thing.document())

    with tree() as root, patch("linked_fleet_client.web.load", loader):
        return median_ms(once, 5)


def conform(loader: Loader) -> float:
    def once(_: int) -> None:
        with contextlib.redirect_stdout(io.StringIO()):
            command([root, "--json", "--no-write"])

    with tree() as root, patch("linked_fleet_client.conform.rdf.load", loader):
        begun = time.thread_time()
        once(0)
        return (time.thread_time() - begun) * 1e3


def memory(name: str) -> float:
    """Measure memory in a process of its own."""
    said = subprocess.run([sys.executable, "-m", __spec__.name, "--memory", name], capture_output=True, check=True)  # noqa: S603
    return float(said.stdout)


def resident_mb() -> float:
    with open("/proc/self/statm") as file:  # noqa: PTH123
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20


def grown_mb(loader: Loader) -> float:
    texts = [description(6, number) for number in range(513)]
    warm = loader(texts[-1], "turtle", BASE)
    gc.collect()
    before = resident_mb()
    kept = [warm, *(loader(text, "turtle", BASE) for text in texts[:-1])]
    gc.collect()
    assert len(kept) == len(texts)
    return resident_mb() - before


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--memory", choices=LOADERS, help=argparse.SUPPRESS)
    if name := parser.parse_args().memory:
        print(grown_mb(LOADERS[name]))
        return
    print(f"| | {' | '.join(LOADERS)} |\n|---|{'---|' * len(LOADERS)}")
    for title, figures in rows():
        print(f"| {title} | {' | '.join(f'{each:.3g}' for each in figures)} |", flush=True)


if __name__ == "__main__":
    main()
