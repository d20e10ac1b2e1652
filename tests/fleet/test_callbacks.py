"""Callbacks at two gateways with one Redis: listed, deleted, failing, suspended and resumed through either of them."""

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from rdflib import URIRef

from browser import DCTERMS, HYBRIT, LF, Page
from gateway_group import Gateway, Hub, angle, arrived, deliveries, gateway, gateways, hub, number, present
from receivers import Answer, CallbackReceiver, receiving, retry_after
from redis_servers import Servers, single
from running import eventually
from subscribers import Socket, events

pytestmark = pytest.mark.virtual


@pytest.fixture(scope="module")
def stage() -> Iterator[Hub]:
    with hub() as stage:
        yield stage


@pytest.fixture(scope="module")
def memory(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Servers]:
    with single(tmp_path_factory.mktemp("redis")) as servers:
        yield servers


@pytest.fixture(scope="module")
def pair(stage: Hub, memory: Servers) -> Iterator[tuple[Gateway, Gateway]]:
    with gateways(stage, memory.url) as (one, other):
        yield one, other


def path(gateway: Gateway, iri: str) -> str:
    return gateway.here(iri).removeprefix(gateway.browser.root.rstrip("/"))


def literal(page: Page, predicate: URIRef) -> str | None:
    found = page.graph.value(page.iri, predicate)
    return None if found is None else str(found)


def test_a_subscription_deleted_at_another_gateway_ends(
    stage: Hub, pair: tuple[Gateway, Gateway], receiver: CallbackReceiver
) -> None:
    """A callback gets no messages, a WebSocket closes with 1000, an event stream ends; both containers show it.

    A callback that is deleted through its own gateway gets none either.
    """
    one, other = pair
    kept = one.subscribed(receiver.url("/kept"))
    at_home = one.subscribed(receiver.url("/at-home"))
    receiver.wait(1, "/at-home")
    assert one.browser.http.delete(at_home).status_code == 204
    callback = one.subscribed(receiver.url("/deleted"))
    with Socket(one.rotation) as socket, events(one.rotation) as stream:
        assert socket.next().angle == stream.next().angle == stage.angle
        iris = {kept, callback, socket.description, stream.description}
        for each in pair:
            assert each.listed() == {path(one, iri) for iri in iris}
        receiver.wait(1, "/kept"), receiver.wait(1, "/deleted")
        for iri in (callback, socket.description, stream.description):
            assert other.browser.http.delete(other.here(iri)).status_code == 204
            assert other.browser.http.delete(other.here(iri)).status_code == 404
        assert socket.until_closed()[0] == 1000
        assert stream.ended()
        assert stream.last_event_id == "cancelled"
        for each in pair:
            assert each.listed() == {path(one, kept)}
        eventually(lambda: one.get(callback).status_code == 404, "its end")
        said = len(receiver.log("/deleted"))
        for _ in range(10):
            stage.step()
            arrived(receiver, "/kept", stage.angle)
        # A delivery in progress may have arrived after the deletion.
        assert len(receiver.log("/deleted")) <= said + 1
        assert angle(receiver.log("/deleted")[-1]) < stage.angle
        assert len(receiver.log("/at-home")) == 1
    assert other.browser.http.delete(other.here(kept)).status_code == 204
    assert one.listed() == other.listed() == set()


def test_the_streams_of_a_killed_gateway_vanish(stage: Hub, memory: Servers, pair: tuple[Gateway, Gateway]) -> None:
    with gateways(stage, memory.url, 1) as (victim,), Socket(victim.rotation) as socket, events(victim.rotation) as sse:
        assert socket.next().angle == sse.next().angle == stage.angle
        gone = {path(victim, iri) for iri in (socket.description, sse.description)}
        for each in pair:
            assert each.listed() == gone
        victim.process.send(signal.SIGKILL)
        for each in pair:
            eventually(lambda each=each: each.listed() == set(), "an empty container")
            for iri in gone:
                here = each.here(each.browser.root + iri[1:])
                eventually(lambda each=each, here=here: each.get(here).status_code == 404, "nothing left of it")


def test_a_failed_delivery_is_tried_again_and_then_the_latest_value_comes(
    stage: Hub, pair: tuple[Gateway, Gateway], receiver: CallbackReceiver
) -> None:
    """A receiver that asked for patience is not tried early because another one fails repeatedly."""
    one, other = pair
    receiver.script(Answer(500), retry_after(1), Answer(hangs_up=True))
    receiver.script(retry_after(600), path="/patient")
    patient = one.subscribed(receiver.url("/patient"))
    iri = one.subscribed(receiver.url())
    first = stage.angle
    page = other.in_state(iri, LF.failing)
    assert literal(page, LF.failures) in ("1", "2", "3")
    assert literal(page, LF.reason)
    for _ in range(50):
        stage.step()
    arrived(receiver, "/callback", stage.angle)
    log = receiver.log("/callback")
    assert [number(seen) for seen in log] == [1, 1, 1, 1, 2]
    assert angle(log[0]) == first  # as it was queued; values in between are conflated
    deliveries(log)
    page = other.in_state(iri, LF.active)
    assert (literal(page, LF.failures), literal(page, LF.lastStatus), literal(page, LF.reason)) == ("0", "204", None)
    assert page.graph.value(page.iri, LF.lastDelivery) != LF.unknown
    assert len(receiver.log("/patient")) == 1
    page = other.in_state(patient, LF.failing)
    assert literal(page, LF.lastStatus) == "503"
    assert other.browser.http.post(str(page.one(HYBRIT.action))).status_code == 204  # resuming ends the wait
    arrived(receiver, "/patient", stage.angle)
    deliveries(receiver.log("/patient"))
    for each in (iri, patient):
        assert other.browser.http.delete(other.here(each)).status_code == 204


def test_a_receiver_that_is_gone_suspends_and_any_gateway_resumes(
    stage: Hub, pair: tuple[Gateway, Gateway], receiver: CallbackReceiver
) -> None:
    one, other = pair
    receiver.default = Answer(410)
    iri = one.subscribed(receiver.url())
    page = other.in_state(iri, LF.suspended)
    assert (literal(page, LF.failures), literal(page, LF.lastStatus)) == ("1", "410")
    assert "410" in (literal(page, LF.reason) or "")
    action = other.browser.page(str(page.one(HYBRIT.action)))
    assert HYBRIT.Action in action.types
    assert literal(action, DCTERMS.title)
    for _ in range(20):
        stage.step()
    # resumed too early: it is suspended again after one attempt
    assert other.browser.http.post(action.url).status_code == 204
    receiver.wait(2)
    other.in_state(iri, LF.suspended)
    receiver.default = Answer()
    assert other.browser.http.post(action.url).status_code == 204
    arrived(receiver, "/callback", stage.angle)
    assert [number(seen) for seen in receiver.log()] == [1, 1, 1, 2]
    page = other.in_state(iri, LF.active)
    assert (page.iri, HYBRIT.action, None) not in page.graph
    assert present(other) == stage.angle
    assert one.browser.http.delete(iri).status_code == 204


def test_a_receiver_that_stalls_or_is_not_there_delays_nobody(
    stage: Hub, pair: tuple[Gateway, Gateway], receiver: CallbackReceiver
) -> None:
    one, other = pair
    with receiving() as closed:
        nobody = closed.url()
    receiver.script(*20 * [Answer(stalls=True)], path="/stalls")
    made = [one.subscribed(url) for url in 5 * [receiver.url("/stalls"), nobody] + [receiver.url("/quick")]]
    receiver.wait(5, "/stalls")
    receiver.wait(1, "/quick")
    for _ in range(100):
        stage.step()
        arrived(receiver, "/quick", stage.angle)
    assert len(deliveries(receiver.log("/quick"))) >= 101
    assert {number(seen) for seen in receiver.log("/stalls")} == {1}
    receiver.release()
    page = other.in_state(made[1], LF.failing)
    assert literal(page, LF.lastStatus) is None
    assert "No connection" in (literal(page, LF.reason) or "")
    for iri in made:
        assert one.browser.http.delete(iri).status_code == 204


def test_without_permission_no_callback_reaches_loopback(
    stage: Hub, tmp_path: Path, receiver: CallbackReceiver
) -> None:
    with gateway(stage, state=tmp_path, allow="") as careful:
        for url in (receiver.url(), receiver.url(host="localhost"), receiver.url(host="2130706433")):
            answer = careful.subscribe(url)
            assert (answer.status_code, answer.headers["content-type"]) == (422, "application/problem+json"), url
            upgrade = {"connection": "Upgrade", "upgrade": "callback", "callback": url}
            assert careful.browser.http.get(careful.rotation, headers=upgrade).status_code == 422
        assert careful.listed() == set()
        stage.step()
        with Socket(careful.rotation) as socket:
            while socket.next().angle != stage.angle:  # the first message may be older
                pass
    assert receiver.connections == 0
