"""Gateways that end regularly: requests in progress are answered, and the others continue everything else."""

import contextlib
import signal

import httpx
import pytest

from browser import DCTERMS, LF
from commanding import (
    ENDED,
    PAN,
    PREFIXES,
    WRIST,
    all_see,
    arm,
    at_all,
    control,
    ended,
    invocations,
    moving,
    of_joint,
    problem,
    put,
    radian,
    slowly,
    state_at,
)
from gateway_group import Gateway, Hub, arrived, deliveries, gateway, gateways
from load import EventFollower, Front, Mover, Reader, SocketFollower, going_on
from parallel import pool
from receivers import Answer, receiving
from redis_servers import Servers
from running import Process, eventually, free_port
from subscribers import Socket, events

pytestmark = pytest.mark.virtual
_UNWELCOME = ("Traceback", "Exception", "ERROR", "could not be remembered", "never retrieved")


def end_cleanly(process: Process) -> None:
    """End the gateway, and check that its log has no errors."""
    assert process.stop() == 0, process.output
    assert not [line for line in process.lines if any(word in line for word in _UNWELCOME)], process.output


def path(url: str) -> str:
    return httpx.URL(url).path


# -- one that ends --------------------------------------------------------------------------------------------------


def test_a_waiting_request_is_answered_and_its_motion_continues(stage: Hub, memory: Servers) -> None:
    with arm(stage.endpoint), gateways(stage, memory.url) as two, pool(1) as workers:
        all_see(two)
        one, other = two
        url = of_joint(one.browser, PAN)
        waiting = workers.submit(lambda: put(one.browser, url, slowly(0.5), prefer="wait=60"))
        moving(other.browser, PAN)
        end_cleanly(one.process)
        answer = waiting.result()
        assert answer.status_code == 202, answer.text
        invocation = other.here(answer.headers["location"])
        assert state_at(other, invocation) == LF.running
        assert ended(other.browser, invocation).one(LF.state) == LF.succeeded


def test_a_request_that_waits_for_a_robot_is_answered(stage: Hub, memory: Servers) -> None:
    """The agent hangs: the gateway says so before it ends, and the other one knows."""
    with (
        arm(stage.endpoint, "--lease-ms", "30000") as agent,
        gateways(stage, memory.url) as two,
        pool(1) as workers,
    ):
        all_see(two)
        one, other = two
        url, there = of_joint(one.browser, WRIST), of_joint(other.browser, WRIST)
        agent.send(signal.SIGSTOP)
        try:
            waiting = workers.submit(put, one.browser, url, radian(1.0))
            eventually(lambda: invocations(other.browser, there), "the request under way")
            end_cleanly(one.process)
            answer = waiting.result()
            assert problem(answer) == (504, "agent-silent")
            at_all([other], lambda each: state_at(each, answer.headers["location"]) == LF.unknown, "silence")
        finally:
            agent.send(signal.SIGCONT)


def test_streams_are_told_to_come_back_and_find_the_latest_value(stage: Hub, memory: Servers) -> None:
    """Also streams created by POST, even if never opened: they wait at the other gateway."""
    with gateways(stage, memory.url) as (one, other):
        made, unopened = (one.posted_stream() for _ in range(2))
        with Socket(one.rotation) as socket, Socket(made) as again, events(one.rotation) as stream:
            for each in (socket, again, stream):
                each.next()
            end_cleanly(one.process)
            assert socket.until_closed()[0] == again.until_closed()[0] == 1012
            assert stream.ended()
            assert stream.last_event_id not in ("", "cancelled")
        stage.step()
        for iri in (made, unopened):
            eventually(lambda iri=iri: path(iri) in other.listed(), "it waits at the other gateway")
            assert other.description(iri).one(LF.deliveryState) == LF.waiting
            with Socket(other.here(iri)) as socket:
                assert socket.next().angle == stage.angle
        with events(other.here(one.rotation), last=stream.last_event_id) as stream:
            assert stream.next().angle == stage.angle
        for iri in (made, unopened):
            assert other.browser.http.delete(other.here(iri)).status_code == 204
        assert other.listed() == set()


def test_a_delivery_under_way_is_handed_over(stage: Hub, memory: Servers) -> None:
    """Its receiver does not respond: another gateway repeats it before the lease of the first would expire.

    It also ends in good order with many callbacks whose receivers do not respond or are not there.
    """
    with receiving() as closed:
        nobody = closed.url()
    with receiving() as receiver, gateways(stage, memory.url) as (one, other):
        iri = one.subscribed(receiver.url())
        receiver.wait(1)
        receiver.script(*20 * [Answer(stalls=True)], path="/stalls")
        dead = {path(one.subscribed(url)) for url in 20 * (nobody, receiver.url("/stalls"))}
        receiver.wait(20, "/stalls")
        receiver.script(Answer(stalls=True))
        stage.step()
        receiver.wait(2, "/callback")
        end_cleanly(one.process)
        stage.step()
        arrived(receiver, "/callback", stage.angle)
        deliveries(receiver.log("/callback"))
        assert other.listed() == {path(iri), *dead}


def test_a_gateway_ends_while_redis_hangs(stage: Hub, memory: Servers) -> None:
    """Its streams get a close, and another gateway adopts its callbacks once Redis answers again."""
    (node,) = memory.nodes
    with receiving() as receiver, gateways(stage, memory.url) as (one, other):
        one.subscribed(receiver.url())
        receiver.wait(1)
        with Socket(one.rotation) as socket, Socket(one.posted_stream()) as made:
            socket.next()
            made.next()
            node.pause()
            try:
                end_cleanly(one.process)
            finally:
                node.resume()
            assert socket.until_closed()[0] == made.until_closed()[0] == 1012
        stage.step()
        arrived(receiver, "/callback", stage.angle)
        eventually(lambda: other.get(other.container).status_code == 200, "Redis")


# -- all of them, one after another ---------------------------------------------------------------------------------


def test_a_rolling_restart_under_load_loses_nothing(stage: Hub, memory: Servers) -> None:
    """Motions, reads, streams and callbacks continue; all responses hold at each gateway, old and new."""
    ports = [free_port(), free_port()]
    roots = [f"http://127.0.0.1:{port}/" for port in ports]
    with contextlib.ExitStack() as stack:
        receiver = stack.enter_context(receiving())
        stack.enter_context(arm(stage.endpoint))
        running = [stack.enter_context(gateway(stage, "--redis-url", memory.url, port=port)) for port in ports]
        all_see(running)
        callbacks = [path(each.subscribed(receiver.url(f"/{index}"))) for index, each in enumerate(running)]
        token = made_known(running[0])
        fronts = [stack.enter_context(contextlib.closing(Front(roots))) for _ in range(4)]
        rotation = path(running[0].rotation)
        action = of_joint(running[0].browser, WRIST)
        mover = Mover(fronts[0], path(action), **token)
        reader = Reader(fronts[1], stage, rotation)
        followers = (SocketFollower(fronts[2], rotation), EventFollower(fronts[3], rotation))
        with going_on(*followers, wake=stage.step):
            with going_on(mover, reader, wake=lambda: None):
                for index, port in enumerate(ports):
                    some(mover, reader)
                    end_cleanly(running[index].process)
                    some(mover, reader)
                    running[index] = stack.enter_context(gateway(stage, "--redis-url", memory.url, port=port))
                    all_see([running[index]])
                some(mover, reader)
            for each in followers:
                eventually(lambda each=each: each.last == stage.angle, "the latest value")
        for each in followers:
            assert each.ends
            assert set(each.ends) <= {1012}
        for each in running:
            same(each, mover, each.here(action))
            assert each.listed() >= set(callbacks)
            eventually(lambda each=each: each.listed() == set(callbacks), "the callbacks alone")
        for index in range(len(callbacks)):
            arrived(receiver, f"/{index}", stage.angle)
            deliveries(receiver.log(f"/{index}"))
        for each in running:
            end_cleanly(each.process)


def some(mover: Mover, reader: Reader) -> None:
    """Wait for further successful requests of the clients."""
    moved, read = len(mover.answered), reader.steps
    eventually(lambda: len(mover.answered) > moved + 1 and reader.steps > read + 1, "clients that go on")


def made_known(gateway: Gateway) -> dict[str, str]:
    """Take control of the arm and give it a title; return the field that proves the control."""
    robot = gateway.browser.robot("ur5")
    answer = put(gateway.browser, str(robot.one(LF.lease)), control("Ada", 600))
    assert answer.status_code == 204, answer.text
    token = {"lock-token": answer.headers["lock-token"]}
    said = put(gateway.browser, str(robot.property(LF.TextProperty)), PREFIXES + '<> lf:value "Left arm" .', **token)
    assert said.status_code == 204, said.text
    return token


def same(gateway: Gateway, mover: Mover, action: str) -> None:
    """Check that data from before the restart is known, and that every requested motion began once."""
    robot = gateway.browser.robot("ur5")
    assert str(robot.graph.value(robot.iri, DCTERMS.title)) == "Left arm"
    lease = gateway.browser.page(str(robot.one(LF.lease)))
    assert str(lease.graph.value(lease.iri, LF.holder)) == "Ada"
    assert problem(put(gateway.browser, action, radian(0.0))) == (409, "controlled")
    listed = invocations(gateway.browser, action)
    assert len(mover.answered) == len(set(mover.answered)) == mover.asked == len(listed)
    assert set(listed) == set(mover.answered)
    for each in mover.answered:
        eventually(lambda each=each: state_at(gateway, each) in ENDED, "an end")
        assert state_at(gateway, each) in (LF.succeeded, LF.preempted)
