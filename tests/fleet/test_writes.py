"""Writes at a real gateway: nothing is lost silently, and each refusal links its constraints."""

import contextlib
import re
import socket
import time
from collections.abc import Iterator

import httpx
import pytest
import rdflib
from rdflib import Literal, URIRef
from rdflib.term import Node

from browser import DCTERMS, HYBRIT, LDP, LF, MATHS, Browser, Page
from commanding import PREFIXES, TURTLE, WRIST, post, problem, put, radian
from linked_fleet_gateway.extensions.world.extension import MAX_BODY_BYTES as MAX_OBJECT_BYTES
from linked_fleet_gateway.resources.annotations import MAX_ANNOTATION_TRIPLES
from small_fleet import Place, live, number

pytestmark = pytest.mark.virtual
_SYNTAXES = ("text/turtle", "application/ld+json", "application/n-triples", "application/rdf+xml")
_UPDATE = {"content-type": "application/sparql-update"}
_SPARQL = """PREFIX lf: <https://w3id.org/linked-fleet#> PREFIX dcterms: <http://purl.org/dc/terms/>
PREFIX vom: <http://vocab.arvida.de/2015/06/vom/vocab#> PREFIX maths: <http://vocab.arvida.de/2015/06/maths/vocab#>
PREFIX ex: <http://example.org/> PREFIX rdfs: <http://www.w3.org/2000/01/rdf-schema#> """
_AT = "lf:position [ maths:x 9 ; maths:y 9 ; maths:z 0.5 ; vom:unit unit:M ]"
_CRATE = f"""<> dcterms:title "crate" ; {_AT} ;
    lf:geometry [ a lf:Sphere ; lf:radius [ vom:numericalValue 0.2 ; vom:unit unit:M ] ] ."""
_CONSTRAINED = str(LDP.constrainedBy)
_MODELS = ("Container", "BasicContainer", "DirectContainer", "IndirectContainer", "NonRDFSource")


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    place = Place(tmp_path_factory.mktemp("place"))
    with place.gateway() as (gateway, browser), place.ur5():
        live(browser, "ur5")
        yield browser
        assert "Traceback" not in gateway.output, gateway.output


@pytest.fixture
def crate(browser: Browser) -> Iterator[str]:
    answer = browser.http.post(_objects(browser), content=PREFIXES + _CRATE, headers={"content-type": "text/turtle"})
    assert answer.status_code == 201, answer.text
    yield answer.headers["location"]
    browser.http.delete(answer.headers["location"])


def _objects(browser: Browser) -> str:
    world = browser.page(str(browser.page(browser.root).one(LF.world)))
    return str(world.one(LF.objects))


def _setting(browser: Browser, name: str) -> str:
    robot = browser.robot("ur5")
    return str(robot.property(LF.TextProperty) if name == "title" else robot.one(LF[name]))


def _written(browser: Browser, crate: str) -> dict[str, str]:
    """Return each resource that accepts PUT, with a body that gives it a state."""
    bodies = {
        "title": '<> lf:value "Arm" .',
        "annotations": "<./> <urn:x/colour> 'red' ; <urn:x/by> [ <urn:x/n> 1 ] .",
        "maximumSpeedScale": "<> lf:value [ vom:numericalValue 0.5 ] .",
        "placement": f"<> {_AT} .",
    }
    urls = {name: _setting(browser, name) for name in bodies}
    for name, body in bodies.items():
        answer = put(browser, urls[name], PREFIXES + body)
        assert answer.status_code == 204, answer.text
    return urls | {"crate": crate}


def _patch(browser: Browser, url: str, update: str, **fields: str) -> httpx.Response:
    return browser.http.patch(url, content=_SPARQL + update, headers=_UPDATE | fields)


def _value(page: Page, predicate: URIRef) -> Node | None:
    return page.graph.value(page.iri, predicate)


def test_writable_resources_accept_their_own_representation(browser: Browser, crate: str) -> None:
    """Each writable resource accepts its own representation, in every syntax of it; nothing changes.

    An object of the world is written in plain JSON too, in which it is not served.
    """
    for name, url in _written(browser, crate).items():
        before = browser.page(url)
        taken = before.response.headers["accept-put"].split(", ")
        assert set(_SYNTAXES) <= set(taken)
        for media_type in taken:
            read = browser.http.get(url, headers={"accept": media_type})
            if (name, media_type) == ("crate", "application/json"):
                assert read.status_code == 406
                continue
            assert read.status_code == 200
            answer = browser.http.put(url, content=read.content, headers={"content-type": media_type})
            assert answer.status_code == 204, f"{name} {media_type} {answer.text} {read.text}"
            assert browser.page(url).response.text == before.response.text


def test_every_constraint_failure_names_its_constraint(browser: Browser, crate: str) -> None:
    """Each 413, 415 and 422 to a write links a readable document by ldp:constrainedBy."""
    robot = browser.robot("ur5")
    joint = browser.part("ur5", "shoulder_pan_joint")
    urls = {
        str(url) for page in (robot, joint) for url in page.graph.objects(page.iri, None) if isinstance(url, URIRef)
    }
    urls = {url for url in urls if url.startswith(browser.root)} | {crate, _objects(browser)}
    urls |= {url + "subscriptions" for url in (browser.root,)}
    seen = set()
    for url in urls:
        allow = browser.http.options(url).headers.get("allow", "")
        for method, media_type, body in _attempts(browser.root):
            if method not in allow:
                continue
            answer = browser.http.request(method, url, content=body, headers={"content-type": media_type})
            if answer.status_code in (413, 415, 422):
                constraint = answer.links[_CONSTRAINED]["url"]
                assert browser.http.get(constraint).status_code == 200, f"{method} {url} {constraint}"
                assert problem(answer)
                assert answer.json()["constraint"] == constraint
                seen.add((url, method, answer.status_code))
    settings = {_setting(browser, name) for name in ("title", "annotations", "maximumSpeedScale", "placement")}
    assert {url for url, *_ in seen} >= {crate, _objects(browser), *settings}
    each = {(method, status) for method in ("PUT", "POST", "PATCH") for status in (413, 415, 422)}
    assert {(method, status) for _, method, status in seen} == each
    assert len(seen) > 45


def _attempts(root: str) -> Iterator[tuple[str, str, str]]:
    """Yield bodies that violate constraints of several kinds; each resource refuses some of them."""
    geometry = "lf:geometry [ a lf:Sphere ; lf:radius [ vom:numericalValue {} ; vom:unit unit:M ] ]"
    bodies = [
        "",
        "<> lf:nothing 1 .",
        "<a> lf:value 1 . <b> lf:value 2 .",
        f"<> dcterms:title 'x' ; {_AT} ; {geometry.format('5e9')} .",
        f"<> dcterms:title 'x' ; {_AT} ; {geometry.format(1)} ; a lf:Obstacle, lf:KeepOutZone .",
        f"<> dcterms:title 'x' ; {_AT} ; {geometry.format(1)} ; lf:inFrame <{root}ur5/> .",
        f"<> dcterms:title 'x' ; {_AT.replace('9', '1e5')} ; {geometry.format(1)} .",
        f"<> dcterms:title 'x' ; {_AT} ; lf:geometry [ a lf:Box ] .",
        f"<> dcterms:title 'x' ; {_AT} ; lf:geometry [ a lf:TriangleMesh ; lf:stl 'AAAA' ] .",
        f"<> {_AT} ; lf:orientation [ maths:x 0 ; maths:y 0 ; maths:z 0 ; lf:w 3 ] .",
        "<./> lf:presence lf:offline .",
        "<> lf:value [ vom:numericalValue 1e-400 ] .",
        "<> vom:numericalValue 0 ; vom:unit unit:RAD ; lf:speedScal 0.1 .",
        f"<> lf:ofLink <{root}ur5/wrist_3_link> ; {_AT} .",
        f"<> a <https://hybr-it-projekt.de/ns/hybr-it#Subscription> ; <urn:x> <{root}> .",
    ]
    for body in bodies:
        for method in ("PUT", "POST"):
            yield method, "text/turtle", PREFIXES + body
    yield "PATCH", _UPDATE["content-type"], _SPARQL + "INSERT DATA { <> ex:p 1 . <http://example.org/x> ex:p 1 }"
    for method, media_type in (("PUT", "text/turtle"), ("POST", "text/turtle"), ("PATCH", _UPDATE["content-type"])):
        yield method, media_type, "#" * (MAX_OBJECT_BYTES + 1)
        yield method, "text/plain", "x"


@pytest.fixture
def full(browser: Browser) -> Iterator[httpx.Response]:
    """Return the response to an object for which the world has no room."""
    objects, turtle, made = _objects(browser), {"content-type": "text/turtle"}, list[str]()
    while (answer := browser.http.post(objects, content=PREFIXES + _CRATE, headers=turtle)).status_code == 201:
        made.append(answer.headers["location"])
    yield answer
    for url in made:
        assert browser.http.delete(url).status_code == 204


def test_a_world_without_room_links_its_constraint(browser: Browser, full: httpx.Response) -> None:
    """409 when the world has its maximum number of objects."""
    assert problem(full) == (409, "conflict")
    assert "no room" in full.json()["detail"]
    assert browser.http.get(full.links[_CONSTRAINED]["url"]).status_code == 200


def test_a_query_is_held_against_no_constraint(browser: Browser) -> None:
    """It is no representation of a resource: 415 lists what is accepted, without a constraint."""
    answer = browser.http.post(browser.root + "query", content="x", headers={"content-type": "text/plain"})
    assert problem(answer)[0] == 415
    assert _CONSTRAINED not in answer.links


@pytest.mark.parametrize("model", _MODELS)
def test_a_model_that_is_not_to_be_had_is_refused(browser: Browser, crate: str, model: str) -> None:
    """POST and PUT with ``Link; rel="type"``: 422 that links the constraint, and nothing is created (LDP 5.2.3.4)."""
    before = browser.page(_objects(browser)).response.text
    link = f'<http://example.org/a,b>; rel="describedby", <http://www.w3.org/ns/ldp#{model}>; rel="type"'
    for method, url in (("POST", _objects(browser)), ("PUT", crate)):
        headers = {"content-type": "text/turtle", "link": link}
        answer = browser.http.request(method, url, content=PREFIXES + _CRATE, headers=headers)
        assert problem(answer) == (422, "unprocessable-content")
        assert model in answer.json()["detail"]
        assert answer.links[_CONSTRAINED]["url"].endswith("/blueprint")
    assert browser.page(_objects(browser)).response.text == before


@pytest.mark.parametrize(
    "link",
    [
        '<http://www.w3.org/ns/ldp#Resource>; rel="type", <http://www.w3.org/ns/ldp#RDFSource>; rel=type',
        '<http://example.org/Crate>; rel="type"',
        '<http://www.w3.org/ns/ldp#Container>; rel="related"; title="rel=\\"type\\""',
        '<http://www.w3.org/ns/ldp#Container>; rel="type"; anchor="http://example.org/"',
        "<http://www.w3.org/ns/ldp#Container; rel=type",
    ],
)
def test_other_links_are_no_matter(browser: Browser, link: str) -> None:
    """Supported models, links of other types or from other resources, and malformed links."""
    headers = {"content-type": "text/turtle", "link": link}
    answer = browser.http.post(_objects(browser), content=PREFIXES + _CRATE, headers=headers)
    assert answer.status_code == 201, answer.text
    browser.http.delete(answer.headers["location"])


# -- preconditions --------------------------------------------------------------------------------------------------


def test_a_target_that_was_set_while_a_body_came_is_not_overwritten(browser: Browser) -> None:
    """If-Match is about the state in which the write is carried out, not about that before its body was read."""
    url = str(browser.part("ur5", WRIST).one(LF.targetRotation))
    condition = {"if-match": browser.http.get(url).headers["etag"]}

    def body(value: float) -> str:
        return PREFIXES + f"<> lf:value [ vom:numericalValue {value} ; vom:unit unit:RAD ] ."

    def slowly() -> Iterator[bytes]:
        yield PREFIXES.encode()
        with contextlib.closing(Browser(browser.root)) as other:
            assert put(other, url, body(0.3)).status_code == 204
        yield body(0.6).encode()

    answer = browser.http.put(url, content=slowly(), headers=TURTLE | condition)
    assert problem(answer) == (412, "precondition-failed")
    page = browser.page(url)
    assert number(page, LF.value) == pytest.approx(0.3)


# -- deletions ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["invocation", "subscription"])
def test_the_blueprint_of_what_was_deleted_is_gone_too(browser: Browser, kind: str) -> None:
    """Also if it was read before."""
    joint = browser.part("ur5", WRIST)
    if kind == "invocation":
        made = post(browser, browser.action(joint, LF.Rotate), radian(0.2), prefer="wait=30")
    else:
        subject = f"[] a hybrit:Subscription ; hybrit:onResource <{joint.iri}> ."
        prefix = "@prefix hybrit: <https://hybr-it-projekt.de/ns/hybr-it#> . "
        made = post(browser, str(joint.one(HYBRIT.subscriptions)), prefix + subject)
    assert made.status_code in (201, 204), made.text
    url = made.headers["location"]
    for _ in range(2):
        assert browser.http.get(url + "/blueprint").status_code == 200
    assert browser.http.delete(url).status_code == 204
    assert browser.http.get(url).status_code == 404
    assert browser.http.get(url + "/blueprint").status_code == 404


# -- PATCH ----------------------------------------------------------------------------------------------------------


def test_a_title_is_patched(browser: Browser) -> None:
    """204; If-Match is respected; a refused update changes nothing."""
    url = _setting(browser, "title")
    assert put(browser, url, PREFIXES + '<> lf:value "one" .').status_code == 204
    old = browser.http.get(url).headers["etag"]
    update = 'DELETE { <> lf:value ?old } INSERT { <> lf:value "two" } WHERE { <> lf:value ?old }'
    answer = _patch(browser, url, update, **{"if-match": old})
    assert (answer.status_code, answer.content) == (204, b"")
    assert _value(browser.page(url), LF.value) == Literal("two")
    assert problem(_patch(browser, url, update, **{"if-match": old})) == (412, "precondition-failed")
    for refused, status in (
        ('INSERT DATA { <> lf:value "three" }', 422),
        ("DELETE WHERE { <> lf:value ?old }", 422),
        ("DELETE WHERE { <> dcterms:title ?title }", 422),
        ("INSERT DATA { <> lf:valeu 1 }", 422),
        ("CLEAR ALL", 400),
        ("LOAD <http://example.org/>", 400),
    ):
        assert problem(_patch(browser, url, refused))[0] == status, refused
    assert _value(browser.page(url), LF.value) == Literal("two")


def test_a_patch_is_sparql(browser: Browser) -> None:
    """415 for any other type, listing what is accepted, as do OPTIONS and GET."""
    url = _setting(browser, "title")
    answer = browser.http.patch(url, content="{}", headers={"content-type": "application/merge-patch+json"})
    assert problem(answer) == (415, "unsupported-media-type")
    for each in (answer, browser.http.options(url), browser.http.get(url)):
        assert each.headers["accept-patch"] == "application/sparql-update"
    assert "PATCH" in browser.http.options(url).headers["allow"]


def test_annotations_are_patched(browser: Browser) -> None:
    """Clients change their own layer; a patch of the agent's layer is refused, naming it."""
    url, robot = _setting(browser, "annotations"), browser.robot("ur5").url
    assert browser.http.delete(url).status_code == 204
    agents = browser.page(url).response.text
    assert _patch(browser, url, f'INSERT DATA {{ <{robot}> ex:colour "red" ; ex:by [ ex:n 1 ] }}').status_code == 204
    assert (None, URIRef("http://example.org/colour"), Literal("red")) in browser.page(url).graph
    answer = _patch(browser, url, f"DELETE WHERE {{ <{robot}> lf:namedPose ?pose }}")
    assert problem(answer) == (422, "unprocessable-content")
    assert "namedPose" in answer.json()["unused"][0]
    assert (
        _patch(browser, url, f"DELETE WHERE {{ <{robot}> ex:colour ?c ; ex:by ?by . ?by ex:n ?n }}").status_code == 204
    )
    assert browser.page(url).response.text == agents


def test_a_placement_and_an_object_are_patched(browser: Browser, crate: str) -> None:
    """One coordinate, in the graph shown by GET."""
    placement = _setting(browser, "placement")
    assert put(browser, placement, PREFIXES + f"<> {_AT} .").status_code == 204
    update = "DELETE { ?at maths:x ?x } INSERT { ?at maths:x 7 } WHERE { <> lf:position ?at . ?at maths:x ?x }"
    for url in (placement, crate):
        assert _patch(browser, url, update).status_code == 204
        page = browser.page(url)
        assert float(str(page.graph.value(_value(page, LF.position), MATHS.x))) == 7.0
    title = 'DELETE { <> dcterms:title ?t } INSERT { <> dcterms:title "box" } WHERE { <> dcterms:title ?t }'
    assert _patch(browser, crate, title).status_code == 204
    assert _value(browser.page(crate), DCTERMS.title) == Literal("box")
    assert problem(_patch(browser, crate, "DELETE WHERE { <> rdfs:seeAlso ?all }")) == (422, "unprocessable-content")
    assert browser.http.delete(placement).status_code == 204


# -- containers -----------------------------------------------------------------------------------------------------


def _preferring(browser: Browser, url: str, said: str) -> tuple[httpx.Response, rdflib.Graph]:
    answer = browser.http.get(url, headers={"prefer": f"return=representation; {said}".rstrip("; ")})
    assert answer.status_code == 200
    return answer, rdflib.Graph().parse(data=answer.text, format="turtle", publicID=url)


def _part(name: str, *parts: str) -> str:
    return f'{name}="{" ".join(f"http://www.w3.org/ns/ldp#Prefer{part}" for part in parts)}"'


def _containers(browser: Browser) -> list[Page]:
    urls = (browser.root, browser.root + "subscriptions", _objects(browser), browser.root + "rules")
    pages = [browser.page(url) for url in urls]
    assert all((page.iri, rdflib.RDF.type, LDP.Container) in page.graph for page in pages)
    return pages


_ITSELF = (
    _part("include", "MinimalContainer"),
    _part("omit", "Containment"),
    _part("omit", "Containment", "Membership"),
)
_ALL = (
    _part("include", "MinimalContainer", "Containment"),
    _part("omit", "Membership"),
    _part("include", "Containment"),
)
_NO_PART = ("", 'include="http://example.org/"', f"{_part('include', 'Containment')}; {_part('omit', 'Containment')}")


def test_a_container_without_what_it_contains(browser: Browser, crate: str) -> None:
    """Minimal or without containment: the container itself, no ``ldp:contains``, no description of a member."""
    for page in _containers(browser):
        itself = {t for t in page.graph if t[0] == page.iri and t[1] != LDP.contains}
        assert len(itself) > 2
        for said in _ITSELF:
            answer, graph = _preferring(browser, page.url, said)
            assert answer.headers["preference-applied"] == "return=representation"
            assert set(graph.triples((page.iri, None, None))) == itself
            assert {each for each in graph.subjects() if isinstance(each, URIRef)} == {page.iri}
            assert (answer.headers["etag"] == page.response.headers["etag"]) == (answer.text == page.response.text)
            fields = {"prefer": f"return=representation; {said}", "if-none-match": answer.headers["etag"]}
            assert browser.http.get(page.url, headers=fields).status_code == 304


def test_other_parts_of_a_container(browser: Browser, crate: str) -> None:
    """Containment alone, or everything; an invalid or contradictory preference is not applied."""
    for page in _containers(browser):
        assert "Prefer" in page.response.headers["vary"]
        assert "preference-applied" not in page.response.headers
        _, graph = _preferring(browser, page.url, _part("omit", "MinimalContainer"))
        assert set(graph.predicates(page.iri)) <= {LDP.contains}
        for said in _ALL:
            answer, _ = _preferring(browser, page.url, said)
            assert (answer.headers["preference-applied"], answer.text) == ("return=representation", page.response.text)
        for said in _NO_PART:
            answer, _ = _preferring(browser, page.url, said)
            assert "preference-applied" not in answer.headers


def test_rdf_sources_state_their_type(browser: Browser, crate: str) -> None:
    """In the body as in the Link field, so that no inference is needed (R1.7)."""
    robot, joint = browser.robot("ur5"), browser.part("ur5", "shoulder_pan_joint")
    pages = [robot, joint, browser.page(crate), browser.page(browser.root)]
    pages += [
        browser.page(str(url)) for page in (robot, joint) for url in page.graph.objects(page.iri, HYBRIT.property)
    ]
    for page in pages:
        stated = set(page.graph.objects(page.iri, rdflib.RDF.type))
        assert (LDP.RDFSource in stated) == (page.url != browser.root), page.url
        assert {each for each in stated if each in LDP} <= _models(page.response), page.url
        assert _models(page.response) - stated <= {LDP.Resource}, page.url


def _models(answer: httpx.Response) -> set[URIRef]:
    """Return the types of the Link field, with the class of all containers beside that of a basic one."""
    found = {URIRef(each) for each in re.findall(r'<([^>]*)>; rel="type"', answer.headers["link"])}
    return found | ({LDP.Container} if LDP.BasicContainer in found else set())


@pytest.mark.parametrize("path", ["actions/stopAll", "ur5/actions/stop", f"ur5/{WRIST}/actions/hold"])
def test_a_stop_with_a_slash_stops(browser: Browser, path: str) -> None:
    plain, slashed = (browser.http.post(browser.root + path + end) for end in ("", "/"))
    assert plain.status_code == slashed.status_code == 204
    for answer in (plain, slashed):
        assert answer.headers["location"].startswith(f"{browser.root}{path}/invocations/")
    cancelled = browser.http.post(f"{slashed.headers['location']}/actions/cancel/")
    assert cancelled.status_code in (204, 409), cancelled.text  # a stop of all robots cannot be cancelled


def test_a_write_with_a_slash_is_that_of_the_resource(browser: Browser) -> None:
    created = browser.http.post(
        _objects(browser) + "/", content=PREFIXES + _CRATE, headers={"content-type": "text/turtle"}
    )
    assert created.status_code == 201, created.text
    thing = created.headers["location"]
    assert thing.startswith(_objects(browser) + "/") and "//" not in httpx.URL(thing).path
    described = browser.http.get(thing, headers={"accept": "text/turtle"}).text
    assert put(browser, thing + "/", described.replace("crate", "box")).status_code == 204
    assert "box" in browser.http.get(thing, headers={"accept": "text/turtle"}).text
    assert browser.http.get(thing + "/").status_code == 308
    assert browser.http.delete(thing + "/").status_code == 204
    assert browser.http.get(thing).status_code == 404
    refused = browser.http.delete(browser.root + "ur5")  # a robot's own path has the slash
    assert refused.status_code == 409
    turned = post(browser, f"{browser.root}ur5/{WRIST}/actions/rotate/", radian(0.1), prefer="dry-run")
    assert turned.status_code == 200, turned.text


def test_annotations_have_one_bound_however_they_are_written(browser: Browser) -> None:
    """What is shown can be sent back, with the statements of the agent."""
    url, robot = _setting(browser, "annotations"), browser.robot("ur5").url
    statements = [f"<{robot}> ex:n{number} {number} ." for number in range(MAX_ANNOTATION_TRIPLES + 1)]
    prefix = "@prefix ex: <http://example.org/> .\n"

    def insert(*said: str) -> int:
        return _patch(browser, url, f"INSERT DATA {{ {' '.join(said)} }}").status_code

    try:
        assert put(browser, url, prefix + "\n".join(statements)).status_code == 413
        assert insert(*statements) == 413
        assert put(browser, url, prefix + "\n".join(statements[:100])).status_code == 204
        assert insert(*statements[100:-1]) == 204
        assert insert(statements[-1]) == 413
        shown = browser.http.get(url, headers={"accept": "text/turtle"})
        assert "n255" in shown.text and "n256" not in shown.text
        assert put(browser, url, shown.text).status_code == 204
    finally:
        browser.http.delete(url)


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("POST", f"ur5/{WRIST}/actions/rotate"),
        ("PUT", f"ur5/{WRIST}/targetRotation"),
        ("PUT", "ur5/title"),
        ("PUT", "ur5/annotations"),
        ("PUT", "ur5/placement"),
        ("PUT", "ur5/lease"),
        ("POST", "world/objects"),
        ("POST", "rules"),
        ("POST", "subscriptions"),
    ],
)
@pytest.mark.parametrize("media_type", ["text/turtle", "application/ld+json"])
def test_an_empty_body_has_the_hint_for_curl(browser: Browser, method: str, path: str, media_type: str) -> None:
    """``curl --data '@prefix …'`` takes the text for the name of a file, and sends nothing."""
    headers = {"content-type": media_type}
    for content, hinted in (("", True), ("{}" if "json" in media_type else "# nothing", False)):
        answer = browser.http.request(method, browser.root + path, content=content, headers=headers)
        if path.endswith("annotations") and not hinted:
            assert answer.status_code == 204  # a document without statements is a state, unlike no document
            continue
        assert answer.status_code in (400, 422), answer.text
        assert ("--data-raw" in answer.json()["detail"]) is hinted, answer.text


def test_a_precondition_holds_until_the_body_has_arrived(browser: Browser, crate: str) -> None:
    """Another client changes the container while the body of a POST is on its way."""
    url, body = httpx.URL(_objects(browser)), (PREFIXES + _CRATE).encode()
    tag = browser.http.get(str(url), headers={"accept": "text/turtle"}).headers["etag"]
    head = (
        f"POST {url.path} HTTP/1.1\r\nHost: {url.netloc.decode()}\r\nIf-Match: {tag}\r\nConnection: close\r\n"
        f"Content-Type: text/turtle\r\nContent-Length: {len(body)}\r\n\r\n"
    )
    with contextlib.closing(socket.create_connection((url.host, url.port))) as slow:
        slow.sendall(head.encode() + body[:100])
        time.sleep(1)
        assert browser.http.delete(crate).status_code == 204
        slow.sendall(body[100:])
        assert slow.recv(65536).startswith(b"HTTP/1.1 412 ")
    assert "crate" not in browser.http.get(str(url), headers={"accept": "text/turtle"}).text
