"""Long representations delay no other request: they are described in steps and written in a thread."""

import asyncio
import threading
from collections.abc import Iterator
from typing import cast

import pytest
from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.http import representation
from linked_fleet_gateway.http.representation import Representation, Representations
from linked_fleet_gateway.http.scheduling import Offload
from linked_fleet_gateway.resources.description import InSteps, run_steps
from linked_fleet_gateway.resources.html import HTML, HtmlWriter, PageContext
from linked_fleet_gateway.resources.resource import Rendition, Resource
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.serialise import RDF_TYPES
from linked_fleet_runtime import background

_BASE = "http://fleet.example"
_STEPS = 5


def _steps(graph: Graph) -> Iterator[None]:
    for number in range(_STEPS):
        graph.add(NamedNode(f"{_BASE}/a#{number}"), NamedNode("urn:x:p"), Literal(str(number)))
        yield


_LONG = Resource("/a", "", InSteps(_steps))


class _Pages:
    """A writer of pages that tells in which thread it is called."""

    def __init__(self) -> None:
        self.threads: list[int] = []

    def write_resource(self, *_: object) -> bytes:
        self.threads.append(threading.get_ident())
        return b"page"


@pytest.mark.parametrize("media_type", RDF_TYPES)
def test_the_document_is_that_of_a_description_at_once(media_type: str) -> None:
    representations = Representations()
    found = asyncio.run(representations.negotiate_interleaved(media_type, _LONG, _BASE, PageContext, Offload()))
    assert found == representations.negotiate(media_type, _LONG, _BASE)


def test_others_run_between_the_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(background, "SLICE_S", 0.0)
    written = list[int]()

    async def count() -> None:
        while True:
            await asyncio.sleep(0)
            written.append(threading.active_count())

    async def run() -> Representation:
        others = asyncio.create_task(count())
        found = await Representations().negotiate_interleaved(None, _LONG, _BASE, PageContext, Offload())
        others.cancel()
        return found

    assert asyncio.run(run()).media_type == "text/turtle"
    assert len(written) >= _STEPS


def test_long_representations_are_written_in_a_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """In each media type; and a page, of whatever it is."""
    threads = list[int]()
    write = representation.render_graph

    def rendered(*arguments: object, **named: object) -> bytes:
        threads.append(threading.get_ident())
        return write(*arguments, **named)  # type: ignore[arg-type]

    monkeypatch.setattr(representation, "render_graph", rendered)
    pages = _Pages()
    representations = Representations(cast(HtmlWriter, pages))
    short = Resource("/b", "", lambda graph: run_steps(_steps(graph)))

    async def run() -> None:
        for media_type in RDF_TYPES:
            await representations.negotiate_interleaved(media_type, _LONG, _BASE, PageContext, Offload())
        await representations.negotiate_interleaved(HTML, short, _BASE, PageContext, Offload())

    asyncio.run(run())
    assert len(threads) == len(RDF_TYPES) and len(pages.threads) == 1
    assert threading.get_ident() not in {*threads, *pages.threads}


def test_long_documents_are_written_in_a_thread_for_readers_and_for_comparison_of_tags() -> None:
    threads = list[int]()

    def write() -> bytes:
        threads.append(threading.get_ident())
        return b"time"

    found = Resource("/b", "", None, documents={"text/csv": Rendition(write, is_long=True)})
    representations, offload = Representations(), Offload()

    async def run() -> None:
        shown = await representations.negotiate_interleaved("text/csv", found, _BASE, PageContext, offload)
        tags = [tag async for tag in representations.etags_interleaved(found, _BASE, PageContext, offload)]
        assert (shown.body, tags) == (b"time", [shown.etag])

    asyncio.run(run())
    assert len(threads) == 2 and threading.get_ident() not in threads


def test_its_tags_are_those_of_its_documents() -> None:
    representations = Representations()

    async def tags() -> list[str]:
        return [tag async for tag in representations.etags_interleaved(_LONG, _BASE, PageContext, Offload())]

    assert asyncio.run(tags()) == list(representations.etags(_LONG, _BASE))
