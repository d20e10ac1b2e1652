"""Streams that resume from the message that their client saw last, by ``Last-Event-ID`` or the query."""

import contextlib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from typing import NamedTuple

import pytest

from browser import LF
from running import eventually
from small_fleet import Place
from subscribers import ARM, Events, ObservedFleet, Socket, TwoJointRobot, events, members, observed_fleet

pytestmark = pytest.mark.virtual
_PRESENT, _NEXT = 0.25, 0.5
_POSTED = """@prefix hybrit: <https://hybr-it-projekt.de/ns/hybr-it#> .
@prefix lf: <https://w3id.org/linked-fleet#> .
<> a hybrit:Subscription ; hybrit:onResource <{}> {} ."""


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ObservedFleet]:
    with observed_fleet(Place(tmp_path_factory.mktemp("resuming"))) as opened:
        yield opened


class Ids(NamedTuple):
    """The ids of messages about one frame, which moved both joints, and of one about the frame before."""

    older: str
    rotation: str
    deadband: str
    alone: str
    shoulder: str
    joint: str
    joint_alone: str
    robot: str

    @property
    def version(self) -> str:
        return self.rotation.partition("~")[0]


def _id(url: str) -> str:
    """Return the id of the present state."""
    with events(url) as stream:
        return stream.next().event_id


@contextlib.contextmanager
def _watched(toy: TwoJointRobot) -> Iterator[Ids]:
    """Watch, so that versions do not depend on when a client asks; move and yield the ids."""
    rotation, joint = toy.rotation(), toy.part().url
    urls = (rotation, rotation + "?deadband=0.1", rotation + "?depth=this", toy.rotation("shoulder"), joint)
    with contextlib.ExitStack() as opened:
        moved = [opened.enter_context(events(url)) for url in urls]
        older, *_ = (stream.next().event_id for stream in moved)
        still = [opened.enter_context(events(url)) for url in (joint + "?depth=this", toy.page.url)]
        toy.pose(_PRESENT, 2 * _PRESENT)
        for stream in (*moved, *still):
            stream.next()
        ids = Ids(older, *(stream.last_event_id for stream in (*moved, *still)))
        assert ids.shoulder.startswith(ids.version + "~"), "both joints have changed in one frame"
        yield ids


Opened = Socket | Events
Opening = Callable[[ObservedFleet, TwoJointRobot, str, str], AbstractContextManager[Opened]]


def _by_field(scene: ObservedFleet, toy: TwoJointRobot, url: str, last: str) -> AbstractContextManager[Opened]:
    return events(url, last=last)


def _by_query(scene: ObservedFleet, toy: TwoJointRobot, url: str, last: str) -> AbstractContextManager[Opened]:
    return events(f"{url}?last-event-id={last}")


def _socket_by_field(scene: ObservedFleet, toy: TwoJointRobot, url: str, last: str) -> AbstractContextManager[Opened]:
    return Socket(url, last=last)


def _socket_by_query(scene: ObservedFleet, toy: TwoJointRobot, url: str, last: str) -> AbstractContextManager[Opened]:
    return Socket(f"{url}?last-event-id={last}")


def _posted(scene: ObservedFleet, toy: TwoJointRobot, url: str, more: str = "") -> str:
    body, fields = _POSTED.format(url, more), {"content-type": "text/turtle"}
    answer = scene.browser.http.post(toy.subscriptions().url, content=body, headers=fields)
    assert answer.status_code == 201, answer.text
    return answer.headers["location"]


def _stored(scene: ObservedFleet, toy: TwoJointRobot, url: str, last: str) -> AbstractContextManager[Opened]:
    return events(_posted(scene, toy, url), last=last)


@contextlib.contextmanager
def _stored_socket(scene: ObservedFleet, toy: TwoJointRobot, url: str, last: str) -> Iterator[Opened]:
    with Socket(_posted(scene, toy, url, "; lf:minimumInterval 0.01"), last=last) as socket:
        yield socket


CASES: dict[str, tuple[Callable[[Ids], str], bool]] = {
    "the same message": (lambda ids: ids.rotation, True),
    "the same message of a subscription with a deadband": (lambda ids: ids.deadband, True),
    "the same message of a subscription without parts": (lambda ids: ids.alone, True),
    "an older message": (lambda ids: ids.older, False),
    "the other joint in the same frame": (lambda ids: ids.shoulder, False),
    "the joint with its values in the same frame": (lambda ids: ids.joint, False),
    "the robot": (lambda ids: ids.robot, False),
    "an earlier run of the agent": (lambda ids: "1" + ids.rotation, False),
    "another tag": (lambda ids: ids.rotation[:-1], False),
    "a version alone, the id of earlier releases": (lambda ids: ids.version, False),
    "a version of an earlier release of an earlier run": (lambda ids: "0-1", False),
    "garbage": (lambda ids: "~~nonsense~", False),
}
OPENINGS = [_by_field, _by_query, _socket_by_field, _socket_by_query, _stored, _stored_socket]


@pytest.mark.parametrize("opening", OPENINGS, ids=lambda opening: opening.__name__.strip("_"))
def test_only_the_id_of_the_present_message_of_this_resource_counts_as_seen(
    scene: ObservedFleet, opening: Opening
) -> None:
    """With it nothing comes before a change; with any other id the present state comes at once."""
    for name, (last, seen) in CASES.items():
        with scene.toy() as toy, _watched(toy) as ids, opening(scene, toy, toy.rotation(), last(ids)) as channel:
            if seen:
                toy.pose(_NEXT, 2 * _PRESENT)
            message = channel.next()
            assert message.angle == (_NEXT if seen else _PRESENT), name


@pytest.mark.parametrize(
    ("known", "resumed", "seen"),
    [
        ("", "", True),
        ("?depth=this", "?depth=this", True),
        ("?depth=this", "", False),
        ("", "?depth=this", False),
        ("", "?depth=subtree", False),
    ],
)
def test_a_thing_with_and_without_its_values_are_two(
    scene: ObservedFleet, known: str, resumed: str, seen: bool
) -> None:
    """A client that has seen the statements of a robot has not seen its values, although their version is the same."""
    with scene.toy() as toy:
        robot = toy.page.url
        toy.actor.leave()
        eventually(lambda: toy.page.one(LF.presence) == LF.offline, "the robot to be offline")
        assert len({_id(robot + query).partition("~")[0] for query in ("", "?depth=this")}) == 1
        last = _id(robot + known)
        with events(robot + resumed, last=last) as one, Socket(robot + resumed, last=last) as two:
            toy.actor.appear(toy.actor.description(ARM, ("shoulder", "elbow")))
            for channel in (one, two):
                message = channel.next()
                first = message.graph.value(message.iri, LF.presence)
                assert first == (LF.online if seen else LF.offline), message.body.decode()


def test_resuming_by_header_and_by_query(scene: ObservedFleet) -> None:
    """Versions belong to the resource: they are the same for all watchers and media types."""
    with scene.toy(0.25) as toy:
        url = toy.rotation()
        with events(url) as before:
            first = before.next()
            assert before.last_event_id == first.event_id
            assert before.comments, "an event stream begins with a comment"
        with (
            Socket(url, "application/ld+json", last=first.event_id) as one,
            Socket(f"{url}?last-event-id={first.event_id}") as two,
            events(url, last=first.event_id) as three,
        ):
            assert {one.description, two.description, three.description} <= members(toy.subscriptions())
            toy.pose(0.25)
            toy.pose(0.5)
            messages = [one.next("application/ld+json"), two.next(), three.next()]
            assert {(each.angle, each.previous) for each in messages} == {(0.5, first.version)}
            assert {each.event_id for each in messages} == {three.last_event_id}
