"""An extension hears of requests, and shows what it stores to those who have the rights that it names."""

from collections.abc import Iterator

import pytest

from authenticated_gateway import SEEN, AuthenticatedGateway, run_authenticated
from browser import LF
from foreign_extension import installed
from running import eventually

pytestmark = pytest.mark.virtual
CODE = """
    from contextlib import asynccontextmanager
    from linked_fleet_gateway.api import (
        Extension, FleetBranch, Literal, LF, Mount, NamedNode, NavigationEntry, NotFound, RequestEvent, Resource, Right,
    )

    class Added(Extension):
        name = "added"
        at_root = ("~diary",)
        navigation = (NavigationEntry("Diary", "/~diary", 80, restricted=True),)

        @asynccontextmanager
        async def start(self, core):
            events = []

            def hear(event):
                if event.event == "note":
                    return
                core.tell_of_request(RequestEvent(event.client, "note", event.path))
                events.append(event)
                if event.request == "the-faulty-one":
                    raise RuntimeError("planted")

            async def load(view, rest):
                if rest:
                    raise NotFound("There is one page only.")

                def describe(graph):
                    for each in events:
                        text = f"{each.client} {each.event} {each.path} {each.robot} {each.status} {each.created}"
                        graph.add(view.iri("/~diary"), LF.reason, Literal(text))

                return Resource("/~diary", "Diary", describe, publishes_changes=False)

            with core.listening_to_requests(hear):
                yield Mount(branches=(FleetBranch("~diary", None, reading=(Right.ACT,), load=load),))
"""


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AuthenticatedGateway]:
    folder = tmp_path_factory.mktemp("diary")
    with installed(folder, "added", CODE), run_authenticated(folder, "--extensions", "added") as found:
        found.add("reader", "read")
        found.add("lab", "read", "act", robots=(SEEN,))
        found.known("reader")
        found.known("lab")
        yield found


@pytest.mark.parametrize(("name", "status"), [(None, 401), ("reader", 403), ("lab", 200), ("root", 200)])
def test_a_branch_is_read_with_the_right_that_it_names(
    here: AuthenticatedGateway, name: str | None, status: int
) -> None:
    with here.browsing(name) as browser:
        for method in ("GET", "HEAD"):
            assert browser.http.request(method, here.root + "~diary").status_code == status, method
        assert browser.http.get(here.root + "~diary/x").status_code == (404 if status == 200 else status)


@pytest.mark.parametrize(("name", "linked"), [("reader", False), ("root", True)])
def test_those_who_may_read_it_get_links(here: AuthenticatedGateway, name: str, linked: bool) -> None:
    with here.browsing(name) as browser:
        for _ in range(2):  # the second answer comes from the cache
            assert ("/~diary>" in browser.http.get(here.root).headers["link"]) == linked
        page = browser.http.get(here.root, headers={"accept": "text/html"}).text
        assert ('/~diary"' in page) == linked
        assert "/~diary" not in browser.http.get(here.root, headers={"accept": "text/turtle"}).text


def test_an_extension_hears_of_requests_that_change_something(here: AuthenticatedGateway) -> None:
    with here.browsing("root") as root, here.browsing("reader") as reader:
        stop = root.action(root.robot(SEEN), LF.StopRobot)
        path = stop.removeprefix(here.root[:-1])
        created = root.http.post(stop).headers["location"].removeprefix(here.root[:-1])
        reader.http.post(stop)
        reader.http.get(root.robot(SEEN).url)
        said = eventually(lambda: root.http.get(here.root + "~diary").text, "the diary")
        assert f"root POST {path} {SEEN} 204 {created}" in said
        assert f"reader POST {path} {SEEN} 403 " in said
        assert " GET " not in said and " note " not in said


def test_an_error_of_a_listener_is_a_fault_and_does_not_concern_the_request(here: AuthenticatedGateway) -> None:
    with here.browsing("root") as root:
        stop = root.action(root.robot(SEEN), LF.StopRobot)
        assert root.http.post(stop, headers={"x-request-id": "the-faulty-one"}).status_code == 204
        ready = root.http.get(here.root + "health/ready").json()
        assert "listeners: added failed: RuntimeError: planted" in str(ready["warnings"])
