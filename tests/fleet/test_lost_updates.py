"""Conditional changes at any gateway never overwrite another client's change."""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import rdflib

from browser import LDP, LF, Browser, Page
from commanding import PREFIXES, TURTLE, at_all
from gateway_group import Gateway, gateways, hub
from parallel import at_once
from redis_servers import single

pytestmark = pytest.mark.virtual
CLIENTS, EACH = 2, 4  # at each of two gateways
SPHERE = (
    "lf:position [ maths:x 9 ; maths:y 9 ; maths:z 9 ; vom:unit unit:M ] ; "
    "lf:orientation [ maths:x 0 ; maths:y 0 ; maths:z 0 ; lf:w 1 ] ; "
    "lf:geometry [ a lf:Sphere ; lf:radius [ vom:numericalValue 1 ; vom:unit unit:M ] ]"
)


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> Iterator[list[Gateway]]:
    folder: Path = tmp_path_factory.mktemp("redis")
    with single(folder) as servers, hub() as stage, gateways(stage, servers.url) as found:
        yield found


def count_up(gateway: Gateway, url: str, read: Callable[[Page], str], write: Callable[[int], str]) -> int:
    """Repeatedly add one to the number in a resource; return how often a precondition failed."""
    refused, left = 0, EACH
    with contextlib.closing(Browser(gateway.browser.root)) as browser:
        while left:
            page = browser.page(gateway.here(url))
            condition = {"if-match": page.response.headers["etag"]}
            body = PREFIXES + write(int(read(page)) + 1)
            answer = browser.http.put(page.url, content=body, headers=TURTLE | condition)
            assert answer.status_code in (204, 412), answer.text
            if answer.status_code == 204:
                left -= 1
                # one's own change is visible
                assert browser.page(page.url).response.headers["etag"] != condition["if-match"]
            else:
                refused += 1
    return refused


def at_both(two: list[Gateway], url: str, read: Callable[[Page], str], write: Callable[[int], str]) -> None:
    def begun(each: Gateway) -> bool:
        there = each.get(each.here(url)).status_code == 200
        return there and read(each.browser.page(each.here(url))) == "0"

    at_all(two, begun, "what is counted")
    refused = at_once([lambda each=each: count_up(each, url, read, write) for each in two * CLIENTS])
    assert sum(refused) > 0, "nobody was in anybody's way"


def test_concurrent_changes_of_objects_are_not_lost(two: list[Gateway]) -> None:
    def read(page: Page) -> str:
        return str(page.one(rdflib.DCTERMS.title))

    def write(count: int) -> str:
        return f'<> a lf:Obstacle ; dcterms:title "{count}" ; {SPHERE} .'

    browser = two[0].browser
    objects = str(browser.page(str(browser.page(browser.root).one(LF.world))).one(LF.objects))
    made = browser.http.post(objects, content=PREFIXES + write(0), headers=TURTLE)
    assert made.status_code == 201, made.text
    url = made.headers["location"]
    at_both(two, url, read, write)
    counts = [int(read(each.browser.page(each.here(url)))) for each in two]
    assert max(counts) == CLIENTS * EACH * len(two)
    for each in two:
        assert each.browser.http.delete(each.here(url)).status_code in (204, 404)
    container = browser.page(objects)
    assert not list(container.graph.objects(container.iri, LDP.contains))


def test_concurrent_changes_of_settings_are_not_lost(two: list[Gateway]) -> None:
    def read(page: Page) -> str:
        return str(page.one(LF.value))

    def write(count: int) -> str:
        return f'<> lf:value "{count}" .'

    url = str(two[0].browser.robot("toy").property(LF.TextProperty))
    assert two[0].browser.http.put(url, content=PREFIXES + write(0), headers=TURTLE).status_code == 204
    at_both(two, url, read, write)
    counts = [int(read(each.browser.page(each.here(url)))) for each in two]
    assert max(counts) == CLIENTS * EACH * len(two)
