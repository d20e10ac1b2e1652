"""The directory of Thing Descriptions (W3C WoT Discovery, 7.3.2.3): as a whole, and by pages."""

import asyncio
import gzip
import json
import re
from types import MappingProxyType, SimpleNamespace
from typing import Any

import pytest
from starlette.responses import Response

from linked_fleet_base.errors import BadRequest, FleetError, PreconditionFailed
from linked_fleet_gateway.extensions.things import kept_listings
from linked_fleet_gateway.extensions.things.directory import MOST, Listing
from linked_fleet_gateway.extensions.things.extension import Directory, _array
from linked_fleet_gateway.http.arrival import create_arrival
from linked_fleet_gateway.http.representation import Representations
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.resources.access_filter import InvocationsInView
from linked_fleet_gateway.resources.branches import RequestView
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_identity.rights import ALL
from linked_fleet_state.invocations import Invocations
from sample_resources import BASE, tree


class _Answer:
    """A response as a client sees it."""

    def __init__(self, response: Response) -> None:
        self.body = b""
        self._response = response

    async def read(self) -> "_Answer":
        async def send(message: Any) -> None:
            if message["type"] == "http.response.start":
                self.status: int = message["status"]
                self.headers = {name.decode(): value.decode() for name, value in message["headers"]}
            else:
                self.body += message.get("body", b"")

        async def receive() -> Any:
            return await asyncio.Event().wait()

        await self._response({"type": "http", "asgi": {"spec_version": "2.4"}}, receive, send)
        return self

    @property
    def ids(self) -> list[str]:
        return [each["id"] for each in json.loads(self.body)]

    def link(self, rel: str) -> str:
        """Return the member of the Link field with this relation, or None."""
        return next((each for each in self.headers["link"].split(", <") if f'rel="{rel}"' in each), "")


class _Services:
    representations = Representations()


async def _at_once(work: Any, size: int) -> Any:
    return work()


def _get(
    query: str = "", *, method: str = "GET", without: str = "", directory: Directory | None = None, **fields: str
) -> _Answer:
    """``without``: a robot that is gone."""
    found = tree().resolve("/things")
    assert isinstance(found, Resource) and isinstance(found.remote, Listing)
    listing = found.remote
    if without:
        robots = {name: robot for name, robot in listing.view.robots.items() if name != without}
        listing = Listing(RequestView(BASE, robots, listing.view.invocations, listing.view.visible_robots))
    headers = [(name.replace("_", "-").encode(), value.encode()) for name, value in fields.items()]
    scope = {"type": "http", "method": method, "path": "/things", "query_string": query.encode(), "headers": headers}
    scope["app"] = SimpleNamespace(services=_Services())
    create_arrival(scope).base = BASE

    async def run() -> _Answer:
        reading = directory or Directory(listing.view.robots, _at_once)
        return await _Answer(await reading.read(Request(scope), found, listing)).read()

    return asyncio.run(run())


def test_a_client_that_does_not_page_gets_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    """However few descriptions one page has."""
    monkeypatch.setattr("linked_fleet_gateway.extensions.things.extension.MOST", 5)
    whole = _get()
    assert len(whole.ids) == len(set(whole.ids)) == 35
    assert len(_get("limit=100").ids) == 5
    assert whole.headers["content-type"] == "application/ld+json"
    assert not whole.link("next") and not whole.link("canonical")


def test_things_are_sorted_by_id() -> None:
    """Ascending, in code point order."""
    ids = _get().ids
    assert ids == sorted(ids) and ids[0] == BASE + "/"


@pytest.mark.parametrize("limit", [1, 10, 34, 35, MOST, 1000])
def test_pages_are_the_whole_in_parts(limit: int) -> None:
    """A page links the next one with the same limit, and the collection with its state."""
    found: list[str] = []
    query, states = f"limit={limit}", set()
    while query:
        page = _get(query)
        found += page.ids
        assert 0 < len(page.ids) <= min(limit, MOST)
        canonical = page.link("canonical")
        assert canonical.startswith(f"<{BASE}/things>") or canonical.startswith(f"{BASE}/things>")
        (state,) = re.findall(r'; etag="([^"]+)"', canonical)
        states.add(state)
        following = re.match(rf"<?{BASE}/things\?([^>]+)>", page.link("next"))
        query = following[1] if following else ""
        assert not query or query == f"offset={len(found)}&limit={limit}"
    assert found == _get().ids
    assert len(states) == 1


def test_the_state_of_the_collection_changes_when_things_come_or_go() -> None:
    before, after = _get("limit=2").link("canonical"), _get("limit=2", without="mute").link("canonical")
    assert before != after
    assert after == _get("limit=9&offset=3", without="mute").link("canonical")


def test_a_page_has_an_etag_of_its_own() -> None:
    page = _get("limit=2")
    again = _get("limit=2", if_none_match=page.headers["etag"])
    assert (again.status, again.body) == (304, b"")
    assert _get("limit=2&offset=2", if_none_match=page.headers["etag"]).status == 200


@pytest.mark.parametrize("most", [10, kept_listings.MAX_LISTING_BYTES])
def test_the_whole_has_an_etag_also_if_it_is_streamed(monkeypatch: pytest.MonkeyPatch, most: int) -> None:
    """R0.11. It is weak if the body is not kept, and changes with the things."""
    monkeypatch.setattr(kept_listings, "MAX_LISTING_BYTES", most)
    tag = _get().headers["etag"]
    assert tag.startswith('W/"') == (most == 10) and _get(method="HEAD").headers["etag"] == tag
    assert (_get(if_none_match=tag).status, _get(if_none_match=tag).body) == (304, b"")
    assert _get(if_none_match=tag, without="mute").status == 200
    assert _get("offset=1", if_none_match=tag).status == 200


def test_the_rest_of_the_collection_is_a_page() -> None:
    rest = _get("offset=30")
    assert len(rest.ids) == 5 and rest.link("canonical") and not rest.link("next")
    assert _get("offset=99").ids == []


@pytest.mark.parametrize(
    "query", ["sort_by=created", "sort_order=desc", "sort_by=id&sort_order=asc", "limit=2&sort_by=x"]
)
def test_an_order_that_is_not_offered_is_501(query: str) -> None:
    with pytest.raises(FleetError) as caught:
        _get(query)
    assert (caught.value.status, caught.value.code) == (501, "not-implemented")


@pytest.mark.parametrize("query", ["limit=x", "limit=0", "limit=-1", "offset=-1", "limit=", "limit=9999999999"])
def test_a_page_that_cannot_be_is_refused(query: str) -> None:
    with pytest.raises(BadRequest):
        _get(query)


@pytest.mark.parametrize("rejected", [True, False])
async def test_parts_that_go_while_the_listing_is_sent_are_left_out(bench: Any, rejected: bool) -> None:
    robot = bench.robot({"pan": ("continuous", ""), "tilt": ("continuous", "")})
    view = RequestView(bench.base, MappingProxyType(bench.fleet.robots), InvocationsInView(Invocations(), ALL), ALL)
    listing, sent = Listing(view), b""
    async for piece in _array(listing, await listing.things()):
        if not sent:
            if rejected:
                robot.reject_description("it is none")
            else:
                bench.robot({"pan": ("continuous", "")})
        sent += piece
    kept = {each["id"].removeprefix(bench.base) for each in json.loads(sent)}
    assert kept == {"/", "/r/"}


class _Counted:
    """Counts the descriptions that are written."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.count, self._usual = 0, Listing.description
        monkeypatch.setattr(Listing, "description", lambda listing, id, place: self._write(listing, id, place))

    def _write(self, listing: Listing, id: str, place: Any) -> bytes | None:
        self.count += 1
        return self._usual(listing, id, place)


@pytest.mark.parametrize("query", ["", "limit=10", "limit=10&offset=20", "offset=30"])
def test_a_listing_is_written_once(monkeypatch: pytest.MonkeyPatch, query: str) -> None:
    counted, directory = _Counted(monkeypatch), Directory({}, _at_once)
    before = [_get(query, directory=directory) for _ in range(3)]
    assert len({(each.body, each.headers["etag"]) for each in before}) == 1
    assert counted.count == len(before[0].ids)
    again = _get(query, directory=directory, if_none_match=before[0].headers["etag"])
    assert (again.status, counted.count) == (304, len(before[0].ids))
    _get(query, directory=directory, without="mute")
    assert counted.count > len(before[0].ids), "another reader, who sees other robots"


def test_a_listing_is_compressed_once_for_those_who_accept_it() -> None:
    directory = Directory({}, _at_once)
    plain, coded = (_get(directory=directory, accept_encoding=coding) for coding in ("identity", "gzip"))
    assert coded.headers["content-encoding"] == "gzip" and gzip.decompress(coded.body) == plain.body
    assert coded.headers["etag"] != plain.headers["etag"] and len(coded.body) < len(plain.body) / 5
    assert _get(directory=directory, accept_encoding="gzip", if_none_match=coded.headers["etag"]).status == 304
    assert coded.headers["vary"] == "Accept, Accept-Encoding"


async def test_requests_at_once_make_a_listing_once(bench: Any) -> None:
    robot = bench.robot({"pan": ("continuous", ""), "tilt": ("continuous", "")})
    begun = list[int]()

    async def parts() -> Any:
        begun.append(1)
        for _ in range(3):
            await asyncio.sleep(0)
            yield robot.name.encode()

    async def is_current() -> bool:
        return True

    kept = kept_listings.KeptListings(_at_once)
    made = await asyncio.gather(*(kept.make(b"key", "", parts, is_current) for _ in range(8)))
    assert len({id(each) for each in made}) == 1 and len(begun) == 1


def test_the_memory_of_listings_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept_listings, "MAX_KEPT_BYTES", 200_000)
    directory = Directory({}, _at_once)
    for offset in range(30):
        _get(f"limit=5&offset={offset}", directory=directory)
        assert sum(each.content.size for each in directory._kept._kept.values()) <= 200_000


async def test_a_listing_of_two_states_is_not_kept() -> None:
    async def parts() -> Any:
        yield b"[]"

    async def is_current() -> bool:
        return False

    kept = kept_listings.KeptListings(_at_once)
    made = await kept.make(b"key", "", parts, is_current)
    assert isinstance(made, kept_listings.KeptListing) and kept.find(b"key") is None


def test_a_head_has_the_fields_of_a_get() -> None:
    head, get = _get(method="HEAD"), _get()
    assert head.headers == get.headers


def test_the_directory_is_available_in_rdf_by_pages() -> None:
    """The same things in the same order, as RDF."""
    ids, found, query = _get().ids, [], "limit=20"
    for _ in range(2):
        answer = _get(query, accept="application/n-triples")
        assert answer.headers["content-type"] == "application/n-triples"
        lines = answer.body.decode().splitlines()
        found += [line.split()[2].strip("<>") for line in lines if line.split()[1].endswith("ldp#contains>")]
        query = next((line.split()[2].strip("<>").partition("?")[2] for line in lines if "vocab#next>" in line), "")
    assert sorted(found) == ids and not query


def test_a_client_can_ask_for_the_list_that_it_knows_alone() -> None:
    """If-Match applies to GET too (RFC 9110, 13.1.1)."""
    tag = _get().headers["etag"]
    assert _get(if_match=tag).status == 200
    with pytest.raises(PreconditionFailed):
        _get(if_match=tag, without="mute")
