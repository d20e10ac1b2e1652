"""PATCH of subscriptions at one of two gateways, while the other serves them."""

from collections.abc import Iterator

import httpx
import pytest
from rdflib import Literal, URIRef

from browser import HYBRIT, LDP, LF, Page
from commanding import problem
from gateway_group import Gateway, Hub, deliveries, gateways, hub, number
from linked_fleet_gateway.http.writes import MAX_PATCH_BYTES
from receivers import Answer, CallbackReceiver
from redis_servers import single
from running import eventually
from subscribers import Socket, events

pytestmark = pytest.mark.virtual
_UPDATE = {"content-type": "application/sparql-update"}
_PROLOGUE = f"PREFIX lf: <{LF}> PREFIX hybrit: <{HYBRIT}> PREFIX dcterms: <http://purl.org/dc/terms/> "
_SECRET = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw"


@pytest.fixture(scope="module")
def stage() -> Iterator[Hub]:
    with hub() as stage:
        yield stage


@pytest.fixture(scope="module")
def two(stage: Hub, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Gateway, Gateway]]:
    with single(tmp_path_factory.mktemp("redis")) as servers, gateways(stage, servers.url) as (one, other):
        yield one, other
        for each in (one, other):
            assert "Traceback" not in each.process.output


def _patch(gateway: Gateway, iri: str, update: str, **fields: str) -> httpx.Response:
    named = {name.replace("_", "-"): value for name, value in fields.items()}
    return gateway.browser.http.patch(gateway.here(iri), content=_PROLOGUE + update, headers=_UPDATE | named)


def _set(**options: str) -> str:
    """Return an update that sets options."""
    names = {name: f"hybrit:{name}" if name in ("mediaType", "onResource") else f"lf:{name}" for name in options}
    before = " ".join(f"<> {names[name]} ?{name} ." for name in options)
    after = " ".join(f"<> {names[name]} {value} ." for name, value in options.items())
    return f"DELETE {{ {before} }} INSERT {{ {after} }} WHERE {{ {before} }}"


def _value(page: Page, predicate: URIRef) -> str:
    return str(page.graph.value(page.iri, predicate))


def test_every_gateway_shows_what_was_patched_through_one(
    two: tuple[Gateway, Gateway], receiver: CallbackReceiver
) -> None:
    """204; all options but the secret are shown; the entity tag is new, and the old one gets 412."""
    one, other = two
    iri = one.subscribed(receiver.url())
    # Deliveries change the description, too: its entity tag is stable once there is nothing to deliver.
    receiver.wait(1)
    one.in_state(iri, LF.active)
    eventually(lambda: _value(one.description(iri), LF.lastStatus) == "204", "the first delivery")
    before = other.description(iri)
    update = _set(mediaType='"application/ld+json"', depth="lf:thisAlone", minimumInterval="2.5", deadband="0.25")
    update = update.replace("INSERT { ", f'INSERT {{ <> lf:secret "{_SECRET}" . ')
    answer = _patch(other, iri, update, if_match=before.response.headers["etag"])
    assert (answer.status_code, answer.content) == (204, b""), answer.text
    for each in two:
        page = each.description(iri)
        options = [_value(page, term) for term in (HYBRIT.mediaType, LF.depth, LF.minimumInterval, LF.signed)]
        assert options == ["application/ld+json", str(LF.thisAlone), "2.5", "true"]
        assert float(_value(page, LF.deadband)) == 0.25
        assert page.response.headers["etag"] != before.response.headers["etag"]
        assert _SECRET not in page.response.text
        for predicate in (HYBRIT.onResource, HYBRIT.callbackURL, LF.failures):
            assert set(page.graph.objects(None, predicate)), predicate
    late = _patch(one, iri, _set(minimumInterval="9"), if_match=before.response.headers["etag"])
    assert problem(late) == (412, "precondition-failed")
    assert _value(other.description(iri), LF.minimumInterval) == "2.5"
    assert one.browser.http.delete(iri).status_code == 204
    assert problem(_patch(other, iri, _set(minimumInterval="1"))) == (404, "not-found")


def test_a_courier_obeys_what_was_patched_at_another_gateway(
    stage: Hub, two: tuple[Gateway, Gateway], receiver: CallbackReceiver
) -> None:
    """In the middle of a stalled delivery: nothing is lost, repeated or out of order, numbers have no gaps."""
    one, other = two
    receiver.script(Answer(), Answer(stalls=True))
    iri = one.subscribed(receiver.url())
    receiver.wait(1)
    stage.step()
    receiver.wait(2)
    answer = _patch(other, iri, _set(mediaType='"application/n-triples"').replace(
        "INSERT { ", f'INSERT {{ <> lf:secret "{_SECRET}" . '
    ))  # fmt: skip
    assert answer.status_code == 204, answer.text
    receiver.release()

    def in_the_new_type() -> bool:
        stage.step()
        return receiver.log()[-1].headers["content-type"] == "application/n-triples"

    eventually(in_the_new_type, "a delivery in the new media type")
    log = deliveries(receiver.log())
    assert [number(seen) for seen in receiver.log()] == [number(seen) for seen in log]
    types = [seen.headers["content-type"] for seen in log]
    assert types == sorted(types, reverse=True)
    assert "webhook-signature" not in log[1].headers
    assert "webhook-signature" in log[-1].headers
    assert one.browser.http.delete(iri).status_code == 204


@pytest.mark.parametrize("opened", [Socket, events], ids=["WebSocket", "event stream"])
def test_an_open_stream_obeys_what_was_patched_at_another_gateway(
    stage: Hub, two: tuple[Gateway, Gateway], opened: type[Socket]
) -> None:
    """An interval of an hour is over once the change arrives, on the same connection; then every value comes."""
    one, other = two
    iri = other.posted_stream(f"; <{LF.minimumInterval}> 3600")
    with opened(one.here(iri)) as stream:
        assert stream.next().angle == stage.angle
        stage.step()
        assert _patch(other, iri, _set(minimumInterval="0")).status_code == 204
        assert stream.next().angle == stage.angle
        for _ in range(3):
            stage.step()
            assert stream.next().angle == stage.angle
        assert _patch(other, iri, _set(depth="lf:wholeSubtree")).status_code == 204
        assert stream.next().angle == stage.angle  # another depth begins with the present state
        refusal = _patch(other, iri, _set(mediaType='"application/ld+json"'))
        assert problem(refusal) == (422, "unprocessable-content")
        assert "mediaType" in refusal.json()["detail"]
        stage.step()
        assert stream.next().angle == stage.angle
        assert other.browser.http.delete(other.here(iri)).status_code == 204


def test_a_patch_that_is_refused_says_why_and_changes_nothing(two: tuple[Gateway, Gateway]) -> None:
    """Each refusal links its constraint if there is one; OPTIONS, GET and 415 list what is accepted."""
    one, _ = two
    iri = one.posted_stream()
    before = one.description(iri).response.text
    for update, status in (
        (_set(minimumInterval="-1"), 422),
        (_set(minimumInterval="1", onResource=f"<{one.joint}>"), 422),
        ("DELETE WHERE { <> dcterms:identifier ?id }", 422),
        ('INSERT DATA { <> lf:reason "mine" }', 422),
        (f'INSERT DATA {{ <> lf:secret "{_SECRET}" }}', 422),
        ("CLEAR ALL", 400),
        ("#" * MAX_PATCH_BYTES, 413),
    ):
        answer = _patch(one, iri, update)
        assert problem(answer)[0] == status, f"{update[:100]}: {answer.text}"
        if status in (413, 422):
            assert one.get(answer.links[str(LDP.constrainedBy)]["url"]).status_code == 200
    foreign = _patch(one, iri, "{}", content_type="application/merge-patch+json")
    assert problem(foreign) == (415, "unsupported-media-type")
    assert one.get(foreign.links[str(LDP.constrainedBy)]["url"]).status_code == 200
    for each in (foreign, one.browser.http.options(iri), one.get(iri)):
        assert each.headers["accept-patch"] == "application/sparql-update"
    assert one.browser.http.options(iri).headers["allow"] == "GET, HEAD, OPTIONS, PATCH, DELETE"
    assert problem(one.browser.http.patch(one.container, content="", headers=_UPDATE))[0] == 405
    assert problem(_patch(one, iri, _set(minimumInterval="1"), if_match='"other"'))[0] == 412
    assert one.description(iri).response.text == before
    assert one.browser.http.delete(iri).status_code == 204


def test_the_media_type_of_a_callback_is_one_of_its_resource(
    two: tuple[Gateway, Gateway], receiver: CallbackReceiver
) -> None:
    """Another one gets 422, as at creation; without any it is the first again."""
    one, other = two
    iri = one.subscribed(receiver.url(), '; hybrit:mediaType "application/ld+json"')
    for media_type in ("image/png", "text/html"):
        refusal = _patch(other, iri, _set(mediaType=f'"{media_type}"'))
        assert problem(refusal) == (422, "unprocessable-content")
        assert "text/turtle" in refusal.json()["detail"]
    assert _patch(other, iri, "DELETE WHERE { <> hybrit:mediaType ?any }").status_code == 204
    page = one.description(iri)
    assert (page.iri, HYBRIT.mediaType, Literal("text/turtle")) in page.graph
    assert one.browser.http.delete(iri).status_code == 204
