"""Two real robots in one world: their places, the objects beside them, and what they would hit."""

import asyncio
import contextlib
import math
import shutil
import time
from base64 import b64encode
from collections.abc import Iterator
from pathlib import Path

import httpx
import pyshacl
import pytest
import rdflib
from rdflib import RDF

from browser import HYBRIT, LF, MATHS, ROS, SH, Browser, Page
from commanding import PAN, PREFIXES, TURTLE, of_joint, post, problem
from linked_fleet_agent.wire.messages import Mesh
from linked_fleet_gateway.extensions.models.meshes import Meshes
from linked_fleet_gateway.extensions.world.scene import MAX_TRIANGLES
from linked_fleet_state.robot import Robot
from meshes import BOX, stl
from running import Process, eventually, free_port, process
from scene_client import container, contents, crate, met, placement, put_object, put_robot, stands, world
from small_fleet import Place, live

pytestmark = pytest.mark.virtual
HYDRA = rdflib.Namespace("http://www.w3.org/ns/hydra/core#")
DRY = {"prefer": "dry-run"}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Place:
    return Place(tmp_path_factory.mktemp("world"))


@pytest.fixture(scope="module")
def robots(place: Place) -> Iterator[Process]:
    with process("-m", "linked_fleet_agent", "--robot=ur5", "--robot=panda", "--connect", place.zenoh) as agents:
        yield agents


@pytest.fixture(scope="module")
def here(place: Place, robots: Process) -> Iterator[tuple[Process, Browser]]:
    with place.gateway() as (gateway, browser):
        for name in ("ur5", "panda"):
            live(browser, name)
        yield gateway, browser


@pytest.fixture
def browser(here: tuple[Process, Browser]) -> Iterator[Browser]:
    """Yield a browser on a world without placements and objects."""
    browser = here[1]
    for name in ("ur5", "panda"):
        assert browser.http.delete(placement(browser, name)).status_code == 204
    for each in contents(browser):
        assert browser.http.delete(each).status_code == 204
    yield browser


def turn(browser: Browser, degrees: float, robot: str = "ur5", joint: str = PAN, **headers: str) -> httpx.Response:
    """Rotate once the shapes are prepared; nothing begins before."""
    body = f"{PREFIXES}[] vom:numericalValue {degrees} ; vom:unit unit:DEG ."
    action = of_joint(browser, joint, robot=robot)

    def answered() -> httpx.Response | None:
        answer = post(browser, action, body, **headers)
        return None if answer.status_code == 503 else answer

    return eventually(answered, "an answer that is not 503")


def said_free(answer: httpx.Response) -> object:
    assert answer.status_code == 200, answer.text
    graph = rdflib.Graph().parse(data=answer.text, format="turtle", publicID="http://rehearsal.test/")
    (said,) = graph.objects(None, LF.collisionFree)
    return said.toPython()  # type: ignore[attr-defined]


def conforms(browser: Browser, page: Page) -> None:
    (blueprint,) = (str(b) for b in page.graph.objects(page.iri, HYBRIT.blueprint) if str(b).startswith(browser.root))
    shapes = browser.page(blueprint).graph
    assert set(shapes.objects(None, SH.targetClass)) & page.types
    data, guard = (rdflib.Graph() + graph for graph in (page.graph, shapes))  # with contexts, which pySHACL demands
    ok, _, text = pyshacl.validate(data, shacl_graph=guard, inference="none")
    assert ok, text


def test_a_robot_without_placement_is_not_checked(browser: Browser) -> None:
    page = browser.page(placement(browser, "ur5"))
    assert {page.graph.value(each, MATHS.x) for each in page.graph.objects(page.iri, LF.position)} == {LF.unknown}
    put_object(browser, crate("all over it", 0, 0, 0, size_mm=3000))
    assert said_free(turn(browser, 10, **DRY)) == str(LF.unknown)
    conforms(browser, page)


def test_world_and_objects_conform_to_their_blueprints(browser: Browser) -> None:
    put_robot(browser, "ur5", 0, 0, 0)
    conforms(browser, world(browser))
    conforms(browser, browser.page(put_object(browser, crate("crate", 1, 1, 0))))
    conforms(browser, browser.page(placement(browser, "ur5")))


def test_refusals_and_rehearsals_name_the_colliding_thing(browser: Browser) -> None:
    put_robot(browser, "ur5", 0, 0, 0)
    there = put_object(browser, crate("crate", 0.5, 0.4, 0.3))
    assert said_free(turn(browser, -20, **DRY)) is True
    for headers in (DRY, {}):
        answer = turn(browser, 90, **headers)
        link, thing = met(answer)
        assert thing == there and browser.page(link).types >= {ROS.Link}
        assert "crate" in answer.json()["detail"]


def test_a_refused_motion_is_remembered_as_failed_and_a_repetition_is_refused_alike(browser: Browser) -> None:
    put_robot(browser, "ur5", 0, 0, 0)
    there = put_object(browser, crate("crate", 0.5, 0.4, 0.3))
    key = {"idempotency-key": '"once"'}
    met(turn(browser, 90, **key))
    assert browser.http.delete(there).status_code == 204
    assert problem(turn(browser, 90, **key)) == (409, "collision")
    assert said_free(turn(browser, 90, **DRY)) is True


def test_a_keep_out_zone_is_no_place_to_go(browser: Browser) -> None:
    put_robot(browser, "ur5", 0, 0, 0)
    put_object(browser, crate("people", 0.5, 0.4, 0.3, kind="lf:KeepOutZone"))
    assert "zone" in turn(browser, 90, **DRY).json()["detail"]


def test_the_other_robot_is_in_the_way_where_it_stands(browser: Browser) -> None:
    put_robot(browser, "ur5", 0, 0, 0)
    put_robot(browser, "panda", 0.2, 0.5, 0)
    _, other = met(turn(browser, 60, **DRY))
    assert other.startswith(str(browser.robot("panda").url)) and browser.page(other).types >= {ROS.Link}
    put_robot(browser, "panda", 0, -5, 0)
    assert said_free(turn(browser, 60, **DRY)) is True


@pytest.mark.parametrize(
    "geometry",
    [
        "a lf:Box",
        "a lf:Box ; lf:size [ maths:x 1 ; maths:y -1 ; maths:z 1 ; vom:unit unit:M ]",
        "a lf:Sphere ; lf:radius [ vom:numericalValue 1e300 ; vom:unit unit:M ]",
        "a lf:Box , lf:Sphere ; lf:radius [ vom:numericalValue 1 ; vom:unit unit:M ]",
        'a lf:TriangleMesh ; lf:stl "c29saWQ="',
        'a lf:TriangleMesh ; lf:stl "%%%"',
        "a lf:TriangleMesh ; lf:mesh <mesh>",
    ],
)
def test_a_body_without_geometry_is_no_object(browser: Browser, geometry: str) -> None:
    body = f'{PREFIXES}<> a lf:Obstacle ; dcterms:title "x" ; {stands(0, 0, 0)} ; lf:geometry [ {geometry} ] .'
    answer = browser.http.post(container(browser).url, content=body, headers=TURTLE)
    assert problem(answer) == (422, "unprocessable-content")


def test_an_object_may_have_as_many_triangles_as_is_said(browser: Browser) -> None:
    mesh = b64encode(stl(BOX[:1] * MAX_TRIANGLES)).decode()
    said = f'{stands(9, 9, 9)} ; lf:geometry [ a lf:TriangleMesh ; lf:stl "{mesh}" ]'
    url = put_object(browser, f'{PREFIXES}<> a lf:Obstacle ; dcterms:title "mesh" ; {said} .')
    assert browser.http.delete(url).status_code == 204


def test_the_pose_of_anything_in_the_frame_of_anything(browser: Browser) -> None:
    put_robot(browser, "ur5", 1, 2, 0.5, math.pi / 2)
    thing = put_object(browser, crate("crate", 1, 3, 0.5))
    robot = browser.robot("ur5")
    template = browser.page(str(world(browser).one(LF.poses)))
    (form,) = template.graph.objects(template.iri, HYDRA.template)
    assert str(form).endswith("{?of,in}")

    def pose(of: str, frame: str | None = None) -> list[float]:
        asked = {"of": of} if frame is None else {"of": of, "in": frame}
        page = browser.page(str(httpx.URL(template.url, params=asked)))
        (iri,) = page.graph.subjects(RDF.type, LF.PoseInFrame)
        vector = page.graph.value(iri, LF.position)
        return [page.graph.value(vector, axis).toPython() for axis in (MATHS.x, MATHS.y, MATHS.z)]  # type: ignore[union-attr]

    tool, wrist = (str(browser.part("ur5", name).url) for name in ("tool0", "wrist_3_link"))
    assert pose(robot.url) == pytest.approx([1, 2, 0.5])
    assert pose(thing, robot.url) == pytest.approx([1, 0, 0], abs=1e-5)  # a metre ahead of a robot that looks along y
    assert pose(tool, wrist) == pytest.approx([0, 0.0823, 0], abs=1e-5)
    x, y, z = pose(tool, robot.url)
    assert pose(tool) == pytest.approx([1 - y, 2 + x, 0.5 + z], abs=2e-5)
    assert browser.http.delete(placement(browser, "ur5")).status_code == 204
    assert pose(tool, wrist) == pytest.approx([0, 0.0823, 0], abs=1e-5)
    assert pose(tool) == [str(LF.unknown)] * 3
    for query in ("?of=nothing", f"?in={tool}", f"?of={tool}&of={tool}", "?x=1"):
        assert problem(browser.http.get(template.url + query)) == (400, "bad-request")
    assert problem(browser.http.get(template.url, params={"of": robot.url + "none"})) == (404, "not-found")


def test_a_motion_that_comes_before_the_shapes_are_prepared_is_not_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A placement survives a restart; the first motion at the new gateway waits longer than a check may take."""
    place = Place(tmp_path)
    get, due_s = Meshes.get, 0.0

    async def get_when_due(self: Meshes, robot: Robot, mesh: Mesh) -> bytes:
        while time.monotonic() < due_s:  # noqa: ASYNC110 - it is known when the motion comes
            await asyncio.sleep(0.1)
        return await get(self, robot, mesh)

    monkeypatch.setattr(Meshes, "get", get_when_due)
    with place.ur5():
        with place.gateway() as (_, browser):
            live(browser, "ur5")
            put_robot(browser, "ur5", 0, 0, 0)
        shutil.rmtree(tmp_path / "meshes")
        due_s = math.inf
        with place.gateway() as (_, browser):
            live(browser, "ur5")
            due_s = time.monotonic() + 4.0
            body = f"{PREFIXES}[] vom:numericalValue 5 ; vom:unit unit:DEG ."
            assert said_free(post(browser, of_joint(browser, PAN), body, **DRY)) is True
            assert post(browser, of_joint(browser, PAN), body).status_code == 204


def test_the_process_that_checks_may_die(here: tuple[Process, Browser], browser: Browser) -> None:
    put_robot(browser, "ur5", 0, 0, 0)
    there = put_object(browser, crate("crate", 0.5, 0.4, 0.3))
    assert met(turn(browser, 90, **DRY))[1] == there
    here[0].kill_child("linked_fleet_gateway.extensions.world.check_process")
    assert met(turn(browser, 90, **DRY))[1] == there


def test_the_world_is_the_same_at_every_gateway_and_outlives_them(place: Place, browser: Browser) -> None:
    put_robot(browser, "ur5", 1, 2, 3)
    there = put_object(browser, crate("crate", 1, 1, 0))
    flags = ("--state-dir", str(place.state), "--zenoh-connect", place.zenoh)
    port = free_port()
    with (
        process("-m", "linked_fleet_gateway", "--port", str(port), *flags) as other,
        contextlib.closing(Browser(f"http://127.0.0.1:{port}/")) as second,
    ):
        other.said("serving")
        live(second, "ur5")
        (same,) = contents(second)
        assert same.removeprefix(second.root) == there.removeprefix(browser.root)
        position = second.page(placement(second, "ur5"))
        assert rdflib.Literal("3.0", datatype=rdflib.XSD.float) in set(position.graph.objects(None, MATHS.z))
        assert second.http.delete(same).status_code == 204
        eventually(lambda: not contents(browser), "the object gone")
