"""The geometry of a real robot over HTTP, found by links: model, meshes, and what is left when the robot is gone."""

import hashlib
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from urllib.parse import urljoin
from xml.etree import ElementTree

import httpx
import pyshacl
import pytest
import rdflib
import zenoh
from rdflib import RDF, URIRef

from browser import DCTERMS, HYBRIT, LF, Browser, Page, links
from fake_robots import KEYS, FakeRobot, link, open_session
from linked_fleet_agent.wire.codec import decode, encode
from linked_fleet_agent.wire.messages import Description, Mesh
from running import Process, eventually
from small_fleet import Place, faulty, live, offline

pytestmark = pytest.mark.virtual
XML = {"accept": "application/xml"}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Place, Process, Browser]]:
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (gateway, browser):
        yield place, gateway, browser


@pytest.fixture(scope="module")
def ur5(place: tuple[Place, Process, Browser]) -> Iterator[Page]:
    with place[0].ur5():
        yield live(place[2], "ur5")


def _model(browser: Browser, robot: Page) -> Page:
    return browser.page(str(robot.one(LF.model)))


def _addresses(browser: Browser, model: Page) -> list[str]:
    """Return the URLs of the meshes in the URDF."""
    answer = browser.http.get(model.url, headers=XML)
    assert answer.status_code == 200
    assert answer.headers["content-type"] == "application/xml"
    root = ElementTree.fromstring(answer.content)
    return [urljoin(model.url, mesh.get("filename", "")) for mesh in root.iter("mesh")]


def test_the_model_is_linked_and_says_what_its_meshes_are(place: tuple[Place, Process, Browser], ur5: Page) -> None:
    browser = place[2]
    model = _model(browser, ur5)
    assert model.url in links(ur5.response, "related")
    assert LF.Model in model.types
    assert model.one(rdflib.RDFS.seeAlso) == ur5.iri
    meshes = set(model.graph.objects(model.iri, LF.mesh))
    assert len(meshes) == 14  # seven visual meshes, and seven collision meshes
    assert {URIRef(each) for each in _addresses(browser, model)} == meshes
    for mesh in meshes:
        answer = browser.http.get(str(mesh))
        assert answer.status_code == 200
        kind = {"dae": "model/vnd.collada+xml", "stl": "model/stl"}[suffix := str(mesh).rpartition(".")[2]]
        assert answer.headers["content-type"] == str(model.graph.value(mesh, DCTERMS.format)) == kind
        assert len(answer.content) == int(model.graph.value(mesh, LF.byteSize))
        digest = hashlib.sha256(answer.content).hexdigest()
        assert digest == str(model.graph.value(mesh, LF.sha256))
        assert answer.headers["etag"] == f'"{digest}"'
        assert str(mesh) == f"{ur5.url}meshes/{digest}.{suffix}"


def test_the_simplified_model_has_the_same_shapes_with_fewer_triangles(
    place: tuple[Place, Process, Browser], ur5: Page
) -> None:
    browser = place[2]
    model = _model(browser, ur5)
    simplified = browser.page(str(model.one(LF.simplified)))
    assert simplified.types >= {LF.SimplifiedModel}
    assert simplified.one(rdflib.RDFS.seeAlso) == model.iri
    (blueprint,) = [
        str(b) for b in simplified.graph.objects(simplified.iri, HYBRIT.blueprint) if str(b).startswith(browser.root)
    ]
    conforms, _, text = pyshacl.validate(simplified.graph, shacl_graph=browser.page(blueprint).graph, inference="none")
    assert conforms, text
    whole, few = _addresses(browser, model), _addresses(browser, simplified)
    assert len(whole) == len(few) == 14
    total = 0
    for address in set(few):
        plain = {"accept-encoding": "identity"}
        answer = browser.http.get(address, headers=plain)
        assert answer.status_code == 200
        assert answer.headers["content-type"] == "model/gltf-binary"
        total += len(answer.content)
        again = browser.http.get(address, headers=plain | {"if-none-match": answer.headers["etag"]})
        assert again.status_code == 304
        assert browser.http.get(address, headers=XML).status_code == 406
    assert total < 1_500_000  # of 9 MB


def test_the_model_conforms_to_its_blueprint_and_not_with_less(
    place: tuple[Place, Process, Browser], ur5: Page
) -> None:
    browser = place[2]
    model = _model(browser, ur5)
    (blueprint,) = [str(b) for b in model.graph.objects(model.iri, HYBRIT.blueprint) if str(b).startswith(browser.root)]
    assert blueprint in links(model.response, "related")
    shapes = browser.page(blueprint).graph
    conforms, _, text = pyshacl.validate(model.graph, shacl_graph=shapes, inference="none")
    assert conforms, text
    mesh = next(model.graph.objects(model.iri, LF.mesh))
    for triple in [*model.graph.triples((model.iri, None, None)), *model.graph.triples((mesh, None, None))]:
        if triple[1] not in (LF.mesh, RDF.type) or triple[2] == LF.Mesh:
            less = rdflib.Graph()
            less += model.graph
            less.remove(triple)
            assert not pyshacl.validate(less, shacl_graph=shapes, inference="none")[0], triple


def test_a_mesh_is_immutable_and_harmless(place: tuple[Place, Process, Browser], ur5: Page) -> None:
    http = place[2].http
    url = _addresses(place[2], _model(place[2], ur5))[0]
    got, head = http.get(url), http.head(url)
    assert got.headers["cache-control"] == "public, max-age=31536000, immutable"
    assert got.headers["x-content-type-options"] == "nosniff"
    assert got.headers["content-security-policy"] == "sandbox; default-src 'none'"
    assert head.status_code == 200
    assert head.content == b""
    for name in ("etag", "content-length", "content-type", "cache-control", "allow"):
        assert head.headers[name] == got.headers[name]
    again = http.get(url, headers={"if-none-match": got.headers["etag"]})
    assert (again.status_code, again.content, again.headers["etag"]) == (304, b"", got.headers["etag"])
    assert http.get(url, headers={"if-match": '"other"'}).status_code == 412
    assert http.get(url, headers={"if-match": got.headers["etag"]}).status_code == 200
    refused = http.get(url, headers={"accept": "text/turtle"})
    assert refused.status_code == 406
    assert "model/vnd.collada+xml" in refused.text
    assert http.put(url, content=b"x").status_code == 405
    assert http.options(url).headers["allow"] == "GET, HEAD, OPTIONS"


def test_the_urdf_has_an_entity_tag_and_may_run_nothing(place: tuple[Place, Process, Browser], ur5: Page) -> None:
    http, url = place[2].http, _model(place[2], ur5).url
    got = http.get(url, headers=XML)
    assert got.headers["content-security-policy"] == "sandbox; default-src 'none'"
    assert http.get(url, headers=XML | {"if-none-match": got.headers["etag"]}).status_code == 304
    assert http.get(url).headers["content-type"].startswith("text/turtle")


@pytest.mark.parametrize(
    "name", ["", "0" * 64 + ".dae", "{digest}.stl", "{digest}", "{digest}.dae/", "..%2Fmodel", "a/b"]
)
def test_there_is_nothing_else_among_the_meshes(place: tuple[Place, Process, Browser], ur5: Page, name: str) -> None:
    digest = _addresses(place[2], _model(place[2], ur5))[0].rpartition("/")[2].partition(".")[0]
    path = httpx.URL(ur5.url).path + "meshes/" + name.format(digest=digest)
    answer = place[2].http.get(httpx.URL(ur5.url).copy_with(raw_path=path.encode()), follow_redirects=False)
    assert answer.status_code in ((308,) if name.endswith(".dae/") else (404,))


def test_an_offline_robot_has_its_model_and_the_meshes_that_were_asked_for(tmp_path: Path) -> None:
    place = Place(tmp_path)
    with place.gateway() as (_, browser):
        with place.ur5():
            first, second = _addresses(browser, _model(browser, live(browser, "ur5")))[:2]
            content = browser.http.get(first).content
        model = _model(browser, offline(browser, "ur5"))
        assert first in _addresses(browser, model)
        assert browser.http.get(first).content == content
        assert browser.http.head(second).status_code == 200
        answer = browser.http.get(second)
        assert answer.status_code == 503
        assert "offline" in answer.text
        assert "immutable" not in answer.headers.get("cache-control", "")


# -- robots of the test's own ----------------------------------------------------------------------------------------

URDF = (
    '<robot name="r"><link name="base">'
    '<visual><geometry><mesh filename="a.stl"/></geometry></visual>'
    '<visual><geometry><mesh filename="&lt;b&gt;.obj"/></geometry></visual>'
    '<visual><geometry><mesh filename="c.glb"/></geometry></visual>'
    '<visual><geometry><sphere radius="1"/></geometry></visual></link></robot>'
)


def _said(content: bytes, uri: str, kind: str = "model/stl") -> Mesh:
    return Mesh(uri=uri, sha256=hashlib.sha256(content).hexdigest(), size=len(content), type=kind)


@pytest.fixture
def observed_fleet(place: tuple[Place, Process, Browser]) -> Iterator[tuple[Process, Browser, zenoh.Session]]:
    with ExitStack() as stack:
        yield place[1], place[2], stack.enter_context(open_session(place[0].zenoh))


def _appear(session: zenoh.Session, name: str, *meshes: Mesh, urdf: str = URDF) -> FakeRobot:
    actor = FakeRobot(session, name)
    said = decode(actor.description(urdf, ()), Description)
    whole = {field: getattr(said, field) for field in said.__struct_fields__} | {"meshes": meshes}
    return actor.appear(encode(Description(**whole))).stand()


def _answers(actor: FakeRobot, session: zenoh.Session, content: bytes) -> list[bytes]:
    """Let the robot answer every question with this content; return the questions."""
    asked: list[bytes] = []
    key = KEYS.robot(actor.name, "mesh")

    def answer(query: zenoh.Query) -> None:
        asked.append(query.payload.to_bytes() if query.payload else b"")
        query.reply(key, content)

    actor.keep(session.declare_queryable(key, answer, complete=True))
    return asked


def test_a_robot_without_meshes_has_a_model_of_its_primitives(
    observed_fleet: tuple[Process, Browser, zenoh.Session],
) -> None:
    _, browser, session = observed_fleet
    _appear(session, "bare")
    model = _model(browser, live(browser, "bare"))
    assert list(model.graph.objects(model.iri, LF.mesh)) == []
    urdf = ElementTree.fromstring(browser.http.get(model.url, headers=XML).content)
    assert [each.tag for each in urdf.iter()] == ["robot", "link", "visual", "geometry", "sphere"]


def test_a_mesh_of_an_unknown_type_is_as_if_it_were_not_there(
    observed_fleet: tuple[Process, Browser, zenoh.Session],
) -> None:
    _, browser, session = observed_fleet
    meshes = _said(b"b", "<b>.obj", "model/obj"), _said(b"c", "c.gltf", "model/gltf+json")
    _appear(session, "typed", *meshes)
    model = _model(browser, live(browser, "typed"))
    (address,) = _addresses(browser, model)
    assert address.endswith(f"/meshes/{meshes[0].sha256}.obj")
    assert str(model.graph.value(URIRef(address), DCTERMS.title)) == "<b>.obj"
    assert browser.http.get(address.replace(meshes[0].sha256 + ".obj", meshes[1].sha256 + ".glb")).status_code == 404


@pytest.mark.parametrize("forged", [b"wrong", b"far too long" * 1000, b"", None])
def test_other_bytes_than_were_described_are_no_answer(
    observed_fleet: tuple[Process, Browser, zenoh.Session], forged: bytes | None
) -> None:
    """Content of the right or another length, none, and an agent without meshes."""
    gateway, browser, session = observed_fleet
    name, mesh = f"forger {len(forged or b'')} {forged is None}", _said(b"right", "a.stl")
    actor = _appear(session, name, mesh)
    asked = [] if forged is None else _answers(actor, session, forged)
    (address,) = _addresses(browser, _model(browser, live(browser, name)))
    for _ in range(2):
        answer = browser.http.get(address)
        assert answer.status_code == 504, answer.text
        assert "wrong" not in answer.text
        assert "cache-control" not in answer.headers or "immutable" not in answer.headers["cache-control"]
    assert set(asked) <= {mesh.sha256.encode()}
    assert "Traceback" not in gateway.output


def test_only_what_is_described_is_asked_for(observed_fleet: tuple[Process, Browser, zenoh.Session]) -> None:
    _, browser, session = observed_fleet
    mesh = _said(b"right", "a.stl")
    actor = _appear(session, "asked", mesh)
    asked = _answers(actor, session, b"right")
    (address,) = _addresses(browser, _model(browser, live(browser, "asked")))
    assert browser.http.get(address.replace(mesh.sha256, "0" * 64)).status_code == 404
    assert browser.http.head(address).headers["content-length"] == "5"
    assert asked == []
    assert browser.http.get(address).content == b"right"
    assert browser.http.get(address).content == b"right"
    assert asked == [mesh.sha256.encode()]


def test_a_faulty_robot_has_no_model(observed_fleet: tuple[Process, Browser, zenoh.Session]) -> None:
    _, browser, session = observed_fleet
    _appear(session, "two", _said(b"right", "a.stl"), urdf=f'<robot name="r">{link("a")}{link("b")}</robot>')
    eventually(lambda: faulty(browser, "two"), "a fault")
    page = browser.robot("two")
    assert page.graph.value(page.iri, LF.model) is None
    assert browser.http.get(page.url + "model").status_code == 404
