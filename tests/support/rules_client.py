"""Rules as clients write them, and their firings; everything is found by links."""

import httpx

from browser import DCTERMS, LDP, LF, Browser, Page
from running import eventually

BEGIN = (
    f"@prefix lf: <{LF}> . @prefix dcterms: <{DCTERMS}> . @prefix unit: <http://qudt.org/vocab/unit/> . "
    "@prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> .\n"
)
QUERY = (
    f"PREFIX lf: <{LF}> PREFIX ros: <http://ros.org/#> PREFIX vom: <http://vocab.arvida.de/2015/06/vom/vocab#> "
    "PREFIX spatial: <http://vocab.arvida.de/2015/06/spatial/vocab#> "
)
TURTLE = {"content-type": "text/turtle"}
TO_TARGET = 'vom:numericalValue [ lf:variable "target" ] ; vom:unit unit:RAD'
BY_SIDE = 'lf:minimumInterval 0 ; lf:toldApartBy "side"'


def sides(joint: str, limit: float = 1.0) -> str:
    """Return a query for the side of an angle (rad) on which a joint is, and a tenth of that angle."""
    at = "ros:rotation/spatial:rotationAngle/vom:numericalValue"
    side = f'BIND(IF(?x > {limit}, "up", "down") AS ?side)'
    return QUERY + f"SELECT ?side ?target WHERE {{ <{joint}> {at} ?x {side} BIND(?x / 10 AS ?target) }}"


def a_rule(condition: str, action: str, body: str = "", more: str = "lf:minimumInterval 0") -> str:
    invokes = action if action.startswith("[") else f"<{action}>"
    said = f"lf:body [ {body} ] ;" if body else ""
    return BEGIN + (
        f'<> a lf:Rule ; dcterms:title "a rule" ; lf:condition """{condition}""" ; '
        f"lf:invokes {invokes} ; {said} {more} ."
    )


def container(browser: Browser) -> str:
    return str(browser.page(browser.root).one(LF.rules))


def post(browser: Browser, text: str) -> httpx.Response:
    return browser.http.post(container(browser), content=text, headers=TURTLE)


def posted(browser: Browser, text: str) -> str:
    """Create a rule and return its IRI."""
    answer = post(browser, text)
    assert answer.status_code == 201, answer.text
    return answer.headers["location"]


def firings(browser: Browser, rule: str) -> list[tuple[str, str]]:
    """Return state and bindings of the firings in order, without those being invoked."""
    page = browser.page(str(browser.page(rule).one(LF.firings)))
    members = sorted(map(str, page.graph.objects(page.iri, LDP.contains)), key=lambda iri: int(iri.rpartition("/")[2]))
    found = [browser.page(each) for each in members]
    return [(_state(each), _side(each)) for each in found if _state(each) != "running"]


def fired(browser: Browser, rule: str, count: int) -> list[tuple[str, str]]:
    return eventually(
        lambda: found if len(found := firings(browser, rule)) >= count else None,
        lambda: f"{count} firings: {browser.page(rule).response.text}",
    )


def put(browser: Browser, rule: str, old: str, new: str) -> httpx.Response:
    """Read a rule, replace text in it, and put it back."""
    page = browser.page(rule)
    assert old in page.response.text, page.response.text
    headers = TURTLE | {"if-match": page.response.headers["etag"]}
    return browser.http.put(rule, content=page.response.text.replace(old, new), headers=headers)


def _state(page: Page) -> str:
    return str(page.one(LF.state)).rpartition("#")[2]


def _side(page: Page) -> str:
    for node in page.graph.objects(page.iri, LF.binding):
        if str(page.graph.value(node, LF.variable)) == "side":
            return str(page.graph.value(node, LF.value))
    return ""
