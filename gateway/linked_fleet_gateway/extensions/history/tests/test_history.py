"""The history of a moving robot, found by links, compared with what the robot has sent."""

import asyncio
import csv
import io
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from datetime import datetime
from functools import partial
from itertools import pairwise

import httpx
import pyshacl
import pytest
import rdflib
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rdflib import Literal, URIRef

from browser import HYBRIT, LF, ROS, SOSA, Browser, Page, links
from fake_robots import KEYS, FakeRobot, open_session
from floor_maps import FREE, UNKNOWN, WALL, pgm, upload, yaml
from linked_fleet_agent.wire.codec import decode_state
from linked_fleet_agent.wire.messages import State
from linked_fleet_gateway.extensions.history import recorder
from linked_fleet_gateway.extensions.history.span import lexical_time
from linked_fleet_state.events import Payload
from parallel import at_once
from running import eventually
from scene_client import put_robot
from small_fleet import Place, live, presence
from virtual.processes import gateway_session

pytestmark = pytest.mark.virtual
HYDRA = rdflib.Namespace("http://www.w3.org/ns/hydra/core#")
JOINT = "elbow_joint"


@dataclass
class Moving:
    """A swaying robot, and everything that it sent, by stamp."""

    browser: Browser
    said: dict[int, State] = field(default_factory=dict)

    @property
    def http(self) -> httpx.Client:
        return self.browser.http

    @property
    def whole(self) -> str:
        return str(self.browser.robot("ur5").one(LF.history))

    @property
    def rotation(self) -> str:
        """The history of a property, linked from the robot's history."""
        rotation = self.browser.part("ur5", JOINT).one(ROS.rotation)
        return str(self.browser.page(self.whole).graph.value(rotation, LF.history))

    def shown(self, url: str, history: str) -> Page:
        """Return the page at ``url``, which shows a part of ``history``."""
        page = self.browser.page(url)
        return Page(history, page.response, page.graph)

    def rows(self, url: str, **query: str) -> list[dict[str, str]]:
        answer = self.http.get(url, params=query, headers={"accept": "text/csv"})
        assert answer.status_code == 200, answer.text
        return list(csv.DictReader(io.StringIO(answer.text, newline="")))


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Place:
    return Place(tmp_path_factory.mktemp("state"))


@pytest.fixture(scope="module")
def moving(place: Place) -> Iterator[Moving]:
    with place.gateway() as (_, browser):
        here = Moving(browser)

        def take(_: str, payload: Payload) -> None:
            assert isinstance(payload, bytes)
            state = decode_state(payload)
            here.said[state.wall_ns] = state

        async def listen() -> None:
            await (await gateway_session(place.zenoh)).subscribe(KEYS.robot("ur5", "state"), 2**20, take)

        asyncio.run(listen())
        with place.ur5("--sway", f"ur5:{JOINT}"):
            live(browser, "ur5")
            eventually(lambda: len(here.rows(here.rotation)) > 40 and len(here.said) > 40, "some seconds of history")
            yield here


def observations(page: Page) -> dict[str, float]:
    graph = page.graph
    return {
        str(graph.value(one, SOSA.resultTime)): float(str(graph.value(one, SOSA.hasSimpleResult)))
        for one in graph.objects(page.iri, SOSA.hasMember)
    }


def test_the_history_has_the_values_of_the_frames(moving: Moving) -> None:
    rows = moving.rows(moving.whole)
    begin = min(moving.said)
    held = {lexical_time(stamp): state for stamp, state in list(moving.said.items())}
    compared = [row for row in rows if row["time"] >= lexical_time(begin)]
    assert len(compared) > 20
    for row in compared:
        state = held[row["time"]]
        values = [float(each) for name, each in row.items() if name != "time"]
        assert values == [*state.positions, *state.velocities, *state.efforts]
    assert len({row[f"{JOINT}/rotation (rad)"] for row in compared}) > 10
    assert [row["time"] for row in rows] == sorted({row["time"] for row in rows})


def test_observations_of_a_property_are_the_same_as_linked_data(moving: Moving) -> None:
    first, last = (row["time"] for row in moving.rows(moving.rotation)[5:17:11])
    rows = moving.rows(moving.rotation, **{"from": first, "to": last})
    assert rows[0]["time"] == first and rows[-1]["time"] < last and len(rows) == 11
    page = moving.shown(f"{moving.rotation}?from={first}&to={last}", moving.rotation)
    cut = [(row["time"][:23] + "Z", float(row["rotation (rad)"])) for row in rows]
    assert observations(page) == {str(Literal(time, datatype=rdflib.XSD.dateTime)): value for time, value in cut}
    rotation = moving.browser.part("ur5", JOINT).one(ROS.rotation)
    assert (page.iri, SOSA.observedProperty, rotation) in page.graph


def test_samples_are_as_far_apart_as_is_asked_for_and_none_is_made_up(moving: Moving) -> None:
    first, last = (row["time"] for row in moving.rows(moving.rotation)[:40:39])
    span = {"from": first, "to": last}
    whole = [row["time"] for row in moving.rows(moving.rotation, **span)]
    few = [row["time"] for row in moving.rows(moving.rotation, **span, every="PT1S")]
    assert set(few) < set(whole)
    assert (few[0], few[-1]) == (whole[0], whole[-1])
    stamps = [datetime.fromisoformat(each).timestamp() for each in few]
    assert all(later - one > 0.999 for one, later in pairwise(stamps[:-1]))
    assert len(few) >= (stamps[-1] - stamps[0]) / 2
    page = moving.shown(f"{moving.rotation}?from={first}&to={last}&every=PT1S", moving.rotation)
    assert len(observations(page)) == len(few)
    paged, url = list[str](), f"{moving.rotation}?from={first}&to={last}&every=PT0.5S&limit=2"
    while url:
        part = moving.http.get(url, headers={"accept": "text/csv"})
        page_rows = [row.partition(",")[0] for row in part.text.splitlines()[1:]]
        assert 0 < len(page_rows) <= 2
        paged += page_rows
        url = next(iter(links(part, "next")), "")
    stamps = [datetime.fromisoformat(each).timestamp() for each in paged]
    assert all(later - one > 0.499 for one, later in pairwise(stamps[:-1]))
    assert len(paged) > 4


def test_a_description_leads_to_all_that_can_be_asked(moving: Moving) -> None:
    """Without building an address: there are links to the last seconds, to files, and to what came before."""
    page = moving.browser.page(moving.rotation)
    assert 0 < len(observations(page)) <= 10
    views = [str(each) for each in page.graph.objects(page.iri, HYDRA.view)]
    assert [len(observations(moving.shown(view, page.url))) > 20 for view in views] == [True, True]
    (before,) = page.graph.objects(page.iri, HYDRA.previous)
    assert links(page.response, "prev") == [str(before)]
    earlier = moving.http.get(str(before))
    assert earlier.status_code == 200 and earlier.text != page.response.text
    whole = moving.browser.page(moving.whole)
    types = {moving.http.get(str(view)).headers["content-type"] for view in whole.graph.objects(whole.iri, HYDRA.view)}
    assert types == {"text/csv; charset=utf-8", "application/vnd.mcap"}
    (template,) = whole.graph.objects(whole.iri, HYDRA.search / HYDRA.template)
    assert str(template) == moving.whole + "{?from,to,last,at,every,limit}"
    rotation = str(moving.browser.part("ur5", JOINT).one(ROS.rotation))
    assert moving.rotation in links(moving.browser.page(rotation).response, "related")


def test_pages_of_a_span_are_all_of_it_and_nothing_twice(moving: Moving) -> None:
    whole = moving.rows(moving.rotation)
    query: dict[str, str] | None = {"from": whole[0]["time"], "to": whole[30]["time"], "limit": "7"}
    url, times = moving.rotation, []
    while True:
        answer = moving.http.get(url, params=query, headers={"accept": "text/csv"})
        times += [row["time"] for row in csv.DictReader(io.StringIO(answer.text, newline=""))]
        if not (following := links(answer, "next")):
            break
        (url,), query = following, None
    assert times == [row["time"] for row in whole[:30]]


def test_another_reader_opens_the_recording(moving: Moving) -> None:
    answer = moving.http.get(moving.whole, headers={"accept": "application/vnd.mcap"})
    assert answer.headers["content-type"] == "application/vnd.mcap"
    assert answer.headers["content-disposition"] == 'attachment; filename="ur5-history.mcap"'
    reader = make_reader(io.BytesIO(answer.content), decoder_factories=[DecoderFactory()])
    messages = [(channel.topic, message, body) for _, channel, message, body in reader.iter_decoded_messages()]
    states = [(message.log_time, body) for topic, message, body in messages if topic == "/joint_states"]
    compared = [(at, body) for at, body in states if at in moving.said]
    assert len(compared) > 20
    for at, body in compared:
        assert tuple(body.position) == moving.said[at].positions and tuple(body.effort) == moving.said[at].efforts
    assert JOINT in states[0][1].name
    (model,) = [body.data for topic, _, body in messages if topic == "/robot_description"]
    mesh = model.split('<mesh filename="')[1].split('"')[0]
    assert moving.http.head(mesh).status_code == 200


def test_the_recording_of_a_placed_robot_opens_with_the_map_of_the_floor(moving: Moving) -> None:
    put_robot(moving.browser, "ur5", 1.0, 2.0, 0.5)
    address = f"{moving.browser.root}world/map"
    image = pgm(((WALL, FREE, UNKNOWN), (WALL, FREE, FREE)))
    assert upload(moving.http, address, image, yaml(0.5, (1.0, -2.0, 0.0))).status_code == 204
    answer = moving.http.get(moving.whole, params={"last": "PT2S", "as": "mcap"})
    assert moving.http.delete(address).status_code == 204
    reader = make_reader(io.BytesIO(answer.content), decoder_factories=[DecoderFactory()])
    found = {channel.topic: body for _, channel, _, body in reader.iter_decoded_messages()}
    assert (found["/map"].header.frame_id, list(found["/map"].data)) == ("world", [100, 0, 0, 100, 0, -1])
    (placed,) = found["/tf_static"].transforms
    at = placed.transform.translation
    assert (placed.header.frame_id, at.x, at.y, at.z) == ("world", 1.0, 2.0, 0.5)


def test_the_poses_of_links_are_remembered_too(moving: Moving) -> None:
    pose = moving.browser.part("ur5", "tool0").one(LF.pose)
    (history,) = [url for url in links(moving.browser.page(str(pose)).response, "related") if url.endswith("history")]
    rows = moving.rows(history, limit="20")
    assert len({row["position.x (m)"] for row in rows}) > 1
    page = moving.browser.page(history)
    position = SOSA.hasMember / SOSA.hasResult / LF.position
    assert len(list(page.graph.objects(page.iri, position))) > 5


def test_histories_conform_to_their_blueprint(moving: Moving) -> None:
    pose = str(moving.browser.part("ur5", "tool0").one(LF.pose)) + "/history"
    for url in (moving.whole, moving.rotation, pose):
        page = moving.browser.page(url)
        (blueprint,) = [each for each in page.graph.objects(page.iri, HYBRIT.blueprint) if each != LF.HistoryShape]
        shapes = moving.browser.page(str(blueprint)).graph
        conforms, _, text = pyshacl.validate(page.graph, shacl_graph=shapes, inference="none")
        assert conforms, f"{url}\n{text}"


@pytest.mark.parametrize(
    "query",
    ["last=x", "from=%ff", "limit=0", "from=2026", "last=PT1S&last=PT2S", "to=" + "9" * 4000, "form=x", "as=yaml",
     "&".join(f"a{n}=1" for n in range(2000))],
)  # fmt: skip
def test_a_query_that_is_none_is_refused(moving: Moving, query: str) -> None:
    for url in (moving.whole, moving.rotation):
        assert moving.http.get(f"{url}?{query}").status_code == (406 if query.startswith("as") else 400)


def test_properties_without_a_history_have_no_resource_for_it(moving: Moving) -> None:
    joint = moving.browser.part("ur5", JOINT)
    for path in ("limits/history", "rotation/history/x", "history"):
        assert moving.http.get(f"{joint.url}/{path}").status_code == 404


def test_a_span_without_samples_is_an_empty_answer(moving: Moving) -> None:
    assert moving.rows(moving.rotation, to="2020-01-01T00:00:00Z") == []
    page = moving.shown(moving.rotation + "?to=2020-01-01T00:00:00Z", moving.rotation)
    assert observations(page) == {}


def test_files_of_a_robot_without_frames_are_empty(moving: Moving, place: Place) -> None:
    def described() -> Page | None:
        page = presence(moving.browser, "silent")
        return page if page is not None and (page.iri, LF.history, None) in page.graph else None

    with open_session(place.zenoh) as session:
        actor = FakeRobot(session, "silent").appear()
        whole = str(eventually(described, "the robot").one(LF.history))
        rotation = str(moving.browser.part("silent", "elbow").one(ROS.rotation))
        for url in (whole, str(moving.browser.page(whole).graph.value(URIRef(rotation), LF.history))):
            answer = moving.http.get(url, headers={"accept": "text/csv"})
            assert answer.status_code == 200, answer.text
            head, *rows = csv.reader(io.StringIO(answer.text, newline=""))
            assert head[0] == "time" and len(head) > 1 and rows == []
        answer = moving.http.get(whole, headers={"accept": "application/vnd.mcap"})
        assert answer.status_code == 200 and list(make_reader(io.BytesIO(answer.content)).iter_messages()) == []
        actor.leave()


def test_too_many_waiting_requests_are_told_to_come_again(moving: Moving, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each would have samples in memory until a thread is free. Files and documents that are not copies wait."""
    to_thread = asyncio.to_thread

    async def slow(work: Callable[[], object]) -> object:
        await asyncio.sleep(1.0)
        return await to_thread(work)

    monkeypatch.setattr(asyncio, "to_thread", lambda work, *more: slow(partial(work, *more)))
    monkeypatch.setattr(recorder, "MAX_WAITING", 3)
    asked = [
        (url, media_type)
        for url in (moving.whole, moving.rotation)
        for media_type in ("text/csv", "application/n-triples")
    ]
    answers = at_once([partial(moving.http.get, url, headers={"accept": each}) for url, each in 3 * asked])
    assert sorted(answer.status_code for answer in answers) == [200] * 5 + [503] * 7
    for refused in (answer for answer in answers if answer.status_code == 503):
        assert "problems#busy" in refused.text and refused.headers["retry-after"] == "1"
    assert len(moving.rows(moving.rotation, limit="3")) == 3


def test_a_page_shows_it_and_leads_to_the_files(moving: Moving) -> None:
    answer = moving.http.get(moving.rotation + "?last=PT10S", headers={"accept": "text/html"})
    assert answer.headers["content-type"].startswith("text/html")
    assert f'href="{moving.rotation}?as=csv&amp;last=PT10S"' in answer.text
    assert "MCAP" not in answer.text


def test_metrics_have_the_memory_of_histories(moving: Moving) -> None:
    text = moving.http.get(moving.browser.root + "metrics").text
    numbers = dict(line.split() for line in text.splitlines() if line.startswith("linked_fleet_history_"))
    samples, size = float(numbers["linked_fleet_history_samples"]), float(numbers["linked_fleet_history_bytes"])
    assert samples > 40 and 184 < size / samples < 300
