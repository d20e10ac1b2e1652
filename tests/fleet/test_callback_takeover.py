"""A killed or delayed gateway loses no callback: another one continues where it was."""

import signal
import time
from collections.abc import Sequence
from itertools import pairwise

import httpx
import pytest

from browser import HYBRIT, LF
from gateway_group import Gateway, Hub, angle, arrived, complete, deliveries, gateways, hub, number, present
from receivers import Answer, CallbackReceiver, receiving
from redis_servers import Servers
from running import eventually

pytestmark = pytest.mark.virtual
CHANGES = 100


def paths(first: int, end: int) -> list[str]:
    return [f"/{index}" for index in range(first, end)]


def subscribe(gateway: Gateway, receiver: CallbackReceiver, paths: Sequence[str]) -> list[str]:
    return [gateway.subscribed(receiver.url(path)) for path in paths]


def drive(hub: Hub, receiver: CallbackReceiver, end: int, at_once: int) -> None:
    """Move up to position ``end``, each time after ``at_once`` deliveries, so that every position is a change."""
    while hub.steps < end:
        count = len(receiver.log(method="POST"))
        hub.step()
        receiver.wait(count + at_once, method="POST")


def test_a_gateway_killed_among_many_changes_loses_nothing(memory: Servers) -> None:
    """20 callbacks, half of them the victim's: each gets the final value, none is missing, repeats are equal."""
    with hub() as stage, receiving() as receiver, gateways(stage, memory.url) as (victim, survivor):
        theirs, ours = paths(0, 10), paths(10, 20)
        made = subscribe(victim, receiver, theirs) + subscribe(survivor, receiver, ours)
        receiver.wait(20, method="POST")
        drive(stage, receiver, CHANGES // 2, 4)
        victim.process.send(signal.SIGKILL)
        victim.process.ended()
        before = {path: len(receiver.log(path, "POST")) for path in theirs}
        drive(stage, receiver, 3 * CHANGES // 4, 4)
        for path in theirs:
            receiver.wait(before[path] + 1, path, "POST")
        drive(stage, receiver, CHANGES, 10)
        assert stage.steps == CHANGES
        for path in theirs + ours:
            arrived(receiver, path, stage.angle)
            deliveries(receiver.log(path, "POST"))
        assert survivor.listed() == {survivor.get(survivor.here(iri)).url.path for iri in made}
        assert len(survivor.listed()) == 20
        for iri in made:
            eventually(lambda iri=iri: survivor.description(iri).one(LF.deliveryState) == LF.active, "all served")


def test_deliveries_of_a_killed_gateway_are_completed(memory: Servers) -> None:
    """A delivery in progress is repeated with the same id; a suspended callback can be resumed elsewhere.

    An unchanged value is delivered once more at most.
    """
    with hub() as stage, receiving() as receiver, gateways(stage, memory.url) as (victim, survivor):
        victim.subscribed(receiver.url("/slow"))
        receiver.wait(1, "/slow")
        receiver.script(Answer(410), Answer(410), path="/gone")
        suspended, resumed = (victim.subscribed(receiver.url("/gone")) for _ in range(2))
        for iri in (suspended, resumed):
            victim.in_state(iri, LF.suspended)
        receiver.script(Answer(stalls=True), path="/slow")
        stage.step()
        receiver.wait(2, "/slow")
        for _ in range(10):
            stage.step()
        quiet = [f"/quiet/{index}" for index in range(5)]
        subscribe(victim, receiver, quiet)
        for path in quiet:
            arrived(receiver, path, stage.angle)
        for _ in range(20):
            stage.repeat()
        resume = survivor.here(str(survivor.description(resumed).one(HYBRIT.action)))
        victim.process.send(signal.SIGKILL)
        # Possibly before another gateway serves it and knows of the end.
        assert survivor.browser.http.post(resume).status_code == 204
        for path in ("/slow", "/gone"):
            arrived(receiver, path, stage.angle)
        slow, gone = receiver.log("/slow"), receiver.log("/gone")
        assert [number(seen) for seen in slow] == [1, 2, 2, 3]
        deliveries(slow)
        assert [number(seen) for seen in gone] == [1, 1, 1, 2]
        assert gone[2].headers["webhook-id"] == f"{httpx.URL(resumed).path.rpartition('/')[2]}.1"
        for _ in range(50):
            stage.repeat()
            time.sleep(0.02)
        stage.step()
        for path in quiet:
            arrived(receiver, path, stage.angle)
            told = [angle(seen) for seen in deliveries(receiver.log(path))]
            assert sum(before == after for before, after in pairwise(told)) <= 1
        assert len(survivor.listed()) == 3 + len(quiet)
        assert survivor.description(suspended).one(LF.deliveryState) == LF.suspended


def test_a_gateway_that_was_thought_dead_disturbs_nobody(memory: Servers) -> None:
    """It is delayed beyond its lease while a delivery is to be repeated, and finds that another serves the callback.

    No older number follows a higher one.
    """
    with hub() as stage, receiving() as receiver, gateways(stage, memory.url) as (slow, quick):
        iri = slow.subscribed(receiver.url())
        receiver.wait(1)
        receiver.default = Answer(500)
        stage.step()
        receiver.wait(5)  # its pause is some seconds now
        slow.process.send(signal.SIGSTOP)
        receiver.default = Answer()
        stage.step()
        arrived(receiver, "/callback", stage.angle)
        slow.process.send(signal.SIGCONT)
        eventually(lambda: slow.get(slow.container).status_code == 200, "the slow one's answer")
        for _ in range(50):  # until the pause that it slept through is over
            stage.step()
            arrived(receiver, "/callback", stage.angle)
            time.sleep(0.2)
        deliveries(receiver.log())
        numbers = [number(seen) for seen in complete(receiver.log())]
        assert numbers == sorted(numbers)
        assert quick.listed() == slow.listed() == {quick.get(quick.here(iri)).url.path}
        eventually(lambda: present(slow) == stage.angle or stage.repeat(), "the slow one connected again")
        # and back: what it remembers is out of date now
        quick.process.send(signal.SIGKILL)
        stage.step()
        arrived(receiver, "/callback", stage.angle)
        deliveries(receiver.log())
