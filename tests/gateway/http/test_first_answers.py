"""First answers to GET: those that need no waiting are there at once, equal to those of the application, in turns."""

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest
from starlette.types import Scope

from gateway_fixtures import Bench
from linked_fleet_gateway.http.answers import ResponseCache
from linked_fleet_gateway.http.arrival import Authenticated, arrival_of
from linked_fleet_gateway.http.endpoint import Endpoint
from linked_fleet_gateway.http.representation import Representations
from linked_fleet_gateway.http.scheduling import Offload, StopPriority
from linked_fleet_gateway.resources import things
from linked_fleet_gateway.resources.branches import NO_BRANCHES, FleetBranch
from linked_fleet_gateway.resources.tree import Tree
from linked_fleet_identity.rights import Grant, Identity, Right, View
from linked_fleet_server.exchange import Reply
from linked_fleet_state.invocations import Invocations

_JOINTS = {"elbow": ("revolute", '<limit lower="-1" upper="1" velocity="2" effort="3"/>')}
_OF_ROBOT = [
    "/", "/r/", "/r/elbow", "/r/base", "/r/elbow/rotation", "/r/elbow/limits", "/r/elbow/blueprint",
    "/r/elbow/actions/rotate", "/r/elbow/actions/rotate/invocations",
]  # fmt: skip
_TYPES = ["text/turtle", "application/ld+json", "application/n-triples", "application/rdf+xml"]


class Place:
    """The endpoint of a gateway with one robot."""

    def __init__(self, bench: Bench) -> None:
        bench.robot(_JOINTS)
        self._bench, self.endpoint = bench, Endpoint()
        branches = NO_BRANCHES.with_branches(FleetBranch("diary", None, reading=(Right.ADMIN,)))
        live = SimpleNamespace(fleet=bench.fleet, branches=branches, tree=self._tree)
        self._app = SimpleNamespace(
            services=SimpleNamespace(
                live=live, response_cache=ResponseCache(), representations=Representations(), identities=None,
                stop_priority=StopPriority(), data_warning=str, writing_offload=Offload(),
                subscriptions=None,
            )
        )  # fmt: skip

    def _tree(self, base: str, sees: View, subscriptions: Any) -> Tree:
        return Tree(self._bench.fleet, Invocations(), base, subscriptions, sees)

    def scope(self, path: str, method: str = "GET", query: bytes = b"", **fields: str) -> Scope:
        headers = [(name.replace("_", "-").encode(), value.encode()) for name, value in fields.items()]
        found: Scope = {
            "type": "http", "method": method, "path": path, "raw_path": path.encode(), "query_string": query,
            "http_version": "1.1", "headers": headers, "app": self._app,
        }  # fmt: skip
        arrival_of(found).base = self._bench.base
        return found

    async def answered(self, scope: Scope) -> tuple[int, dict[bytes, bytes], bytes]:
        """Return status, fields and content of the response by the application."""
        sent: list[Any] = []

        async def send(message: Any) -> None:
            sent.append(message)

        async def receive() -> Any:
            raise AssertionError("nothing is read")

        await self.endpoint(scope, receive, send)
        return sent[0]["status"], dict(sent[0]["headers"]), sent[1]["body"]


@pytest.fixture
def place(bench: Bench) -> Place:
    return Place(bench)


def _parts(reply: Reply | None) -> tuple[int, dict[bytes, bytes], bytes]:
    assert reply is not None
    return reply.status, dict(reply.fields), reply.content


@pytest.mark.parametrize("media_type", _TYPES)
@pytest.mark.parametrize("path", _OF_ROBOT)
async def test_a_first_answer_is_that_of_the_application(bench: Bench, path: str, media_type: str) -> None:
    place, other = Place(bench), Place(bench)
    found = _parts(place.endpoint.reply_nowait(place.scope(path, accept=media_type)))
    assert found[0] == 200 and found[1][b"content-type"].startswith(media_type.encode())
    assert found == await other.answered(other.scope(path, accept=media_type))


async def test_a_client_that_has_the_representation_gets_304(place: Place) -> None:
    tag = (await place.answered(place.scope("/r/elbow/limits")))[1][b"etag"].decode()
    await asyncio.sleep(0)  # the next turn
    found = _parts(place.endpoint.reply_nowait(place.scope("/r/elbow/limits", accept="text/turtle", if_none_match=tag)))
    assert (found[0], found[1][b"etag"], found[2]) == (304, tag.encode(), b"")


async def test_the_list_of_a_small_fleet_is_kept_while_it_shows_the_same(place: Place, bench: Bench) -> None:
    def read() -> Reply | None:
        return place.endpoint.reply_nowait(place.scope("/", accept="text/turtle"))

    assert b"lf:presence lf:online" in _parts(read())[2]
    assert read() is not None  # in the same turn: it is kept
    bench.fleet.robots["r"].set_online(False)
    await asyncio.sleep(0)
    assert b"lf:presence lf:offline" in _parts(read())[2]


async def test_only_readers_of_a_restricted_branch_are_shown_its_link(place: Place) -> None:
    """Both see the same robots, and the representations are equal."""
    found = []
    for rights in (frozenset({Right.ADMIN, Right.READ}), frozenset({Right.READ})):
        scope = place.scope("/", accept="text/turtle")
        arrival_of(scope).authenticated = Authenticated(Identity("somebody", (Grant(rights),)))
        found.append(_parts(place.endpoint.reply_nowait(scope))[1][b"link"])
        await asyncio.sleep(0)
    assert [b"/diary>" in link for link in found] == [True, False]


async def test_the_list_of_a_large_fleet_is_left_to_the_application(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is described in steps."""
    monkeypatch.setattr(things, "MAX_AT_ONCE", 0)
    assert place.endpoint.reply_nowait(place.scope("/")) is None


async def test_a_query_is_not_taken_for_an_accept_field(place: Place) -> None:
    picked = place.scope("/r/elbow", query=b"as=jsonld")
    assert _parts(place.endpoint.reply_nowait(picked))[1][b"content-type"] == b"application/ld+json"
    await asyncio.sleep(0)
    found = _parts(place.endpoint.reply_nowait(place.scope("/r/elbow", accept="as=jsonld")))
    assert found[1][b"content-type"] == b"text/turtle; charset=utf-8"


async def test_a_format_picked_by_the_query_is_kept_too(place: Place) -> None:
    for accept in ("application/ld+json", "as=turtle"):
        found = [
            _parts(place.endpoint.reply_nowait(place.scope("/r/elbow", query=query, accept=accept)))
            for query in (b"as=turtle", b"as=jsonld", b"as=turtle")
            if await asyncio.sleep(0) is None
        ]
        types = [each[1][b"content-type"] for each in found]
        assert types == [b"text/turtle; charset=utf-8", b"application/ld+json", b"text/turtle; charset=utf-8"]


async def test_only_one_first_answer_is_made_in_a_turn(place: Place) -> None:
    def read(path: str) -> Reply | None:
        return place.endpoint.reply_nowait(place.scope(path))

    assert read("/r/elbow") is not None
    assert read("/r/base") is None
    assert read("/r/elbow") is not None  # by now it is cached
    await asyncio.sleep(0)
    assert read("/r/base") is not None


async def test_the_application_makes_the_same_decision_once(place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is not made again for a request that has been found to need waiting."""
    asked, find = list[object](), ResponseCache.find
    monkeypatch.setattr(ResponseCache, "find", lambda *given: asked.append(given) or find(*given))
    assert place.endpoint.reply_nowait(place.scope("/r/elbow")) is not None
    waits = place.scope("/r/base")
    assert place.endpoint.reply_nowait(waits) is None  # another request has the turn
    assert (await place.answered(waits))[0] == 200
    assert len(asked) == 2
    assert (await place.answered(place.scope("/r/elbow")))[0] == 200
    assert len(asked) == 3


@pytest.mark.parametrize(
    "more",
    [
        {"path": "/r"}, {"path": "/r/nothing"}, {"path": "/audit"}, {"path": "/r/elbow/linkset"},
        {"path": "/r/elbow/subscriptions"}, {"path": "/subscriptions"}, {"method": "POST"}, {"method": "OPTIONS"},
        {"query": b"as=csv"}, {"query": b"as=turtle&limit=1"}, {"accept": "text/event-stream"}, {"accept": "image/png"},
        {"accept": "Text/Event-Stream, text/turtle;q=0.5"},
        {"prefer": "return=minimal"}, {"if_match": '"x"'}, {"upgrade": "callback"},
        {"accept": "application/x-jelly-rdf"}, {"path": "/r/elbow/rotation", "accept": "application/json"},
    ],
)  # fmt: skip
async def test_everything_else_is_left_to_the_application(
    place: Place, more: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is written in vain."""
    written = list[object]()
    monkeypatch.setattr(Representations, "negotiate", lambda *asked: written.append(asked))
    assert place.endpoint.reply_nowait(place.scope(**{"path": "/r/elbow", **more})) is None
    assert not written


async def test_a_caller_without_the_right_is_left_to_the_application(place: Place) -> None:
    scope = place.scope("/r/elbow")
    grants = (Grant(frozenset({Right.STOP}), ("r",)),)
    arrival_of(scope).authenticated = Authenticated(Identity("somebody", grants))
    assert place.endpoint.reply_nowait(scope) is None
