"""The recorded data of one robot: ordered, as old as configured, within its memory limit."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_agent.wire.codec import encode_state
from linked_fleet_agent.wire.messages import State
from linked_fleet_gateway.extensions.history.track import Joints, Track, wall_ns
from linked_fleet_state.events import Latest
from linked_fleet_state.model import RobotModel

S = 1_000_000_000
URDF = """<robot name='r'><link name='a'/><link name='b'/>
<joint name='turn' type='continuous'><parent link='a'/><child link='b'/></joint></robot>"""
MODEL = RobotModel.for_urdf(URDF)


def frame(stamp_ns: int, value: float = 0.0) -> bytes:
    row = (value,)
    return encode_state(
        State(incarnation=1, sequence=1, monotonic_ns=1, wall_ns=stamp_ns, positions=row, velocities=row, efforts=row)
    )


def track(*stamps_ns: int, keep_ns: int = 1000 * S) -> Track:
    made = Track(Latest("r", (frame(0), 0, 1, 0)), Joints(MODEL, ("turn",), False))
    for stamp_ns in stamps_ns:
        made.append(frame(stamp_ns), keep_ns)
    return made


def stamps(of: Track, begin: int | None = None, end: int | None = None, most: int = 10_000) -> list[int]:
    return [wall_ns(each) for each in of.excerpt(begin, end, most).frames]


def test_samples_older_than_is_asked_for_are_let_go() -> None:
    kept = track(*range(0, 100 * S, S), keep_ns=10 * S)
    assert stamps(kept) == list(range(89 * S, 100 * S, S))
    assert kept.time_range == (89 * S, 99 * S)


def test_a_span_has_its_beginning_and_not_its_end() -> None:
    kept = track(10, 20, 30, 40)
    assert stamps(kept, 20, 40) == [20, 30]
    assert stamps(kept, 21, 41) == [30, 40]
    assert stamps(kept, 41) == stamps(kept, None, 10) == stamps(kept, 40, 20) == []


def test_with_a_beginning_the_first_samples_are_shown_and_without_the_newest() -> None:
    kept = track(10, 20, 30, 40)
    first, last = kept.excerpt(10, None, 2), kept.excerpt(None, 40, 2)
    assert ([*map(wall_ns, first.frames)], first.before, first.after) == ([10, 20], None, 30)
    assert ([*map(wall_ns, last.frames)], last.before, last.after) == ([20, 30], 10, None)


def test_samples_later_than_a_clock_that_was_set_back_are_dropped() -> None:
    assert stamps(track(10, 20, 30, 25, 26)) == [10, 20, 25, 26]
    assert stamps(track(10, 20, 20)) == [10, 20]


@given(st.lists(st.integers(0, 10**12), min_size=1, max_size=60), st.integers(0, 20_000), st.integers(1, 10**12))
def test_samples_stay_in_order_and_bounded_with_the_newest_kept(stamps_ns: list[int], most: int, keep_ns: int) -> None:
    kept = track(*stamps_ns, keep_ns=keep_ns)
    newest, before = kept.newest, stamps(kept)
    assert before == sorted(set(before)) and before[-1] - before[0] <= keep_ns
    kept.shrink_to(most)
    assert kept.newest is newest and set(stamps(kept)) <= set(before)
    assert kept.bytes <= most or len(kept) == 1


def test_the_older_samples_are_the_farther_apart_they_stay() -> None:
    kept = track(*range(0, 300 * S, S // 10))
    one = kept.bytes // len(kept)
    kept.shrink_to(60 * one)
    assert 30 <= len(kept) <= 60
    newest, *older = reversed(stamps(kept))
    ages = [newest - each for each in older]
    assert ages[:3] == [S // 10, 2 * S // 10, 3 * S // 10] and ages[-1] > 200 * S
    assert all(later - sooner <= later / 2 for sooner, later in pairwise(ages[3:]))


def test_a_track_that_may_take_more_again_is_dense_again() -> None:
    kept = track(*range(0, 300 * S, S // 10))
    one = kept.bytes // len(kept)
    kept.shrink_to(20 * one)
    for stamp_ns in range(300 * S, 600 * S, S // 10):
        kept.append(frame(stamp_ns), 300 * S)
        if kept.bytes > 2000 * one:
            kept.shrink_to(1500 * one)
    assert len(kept) > 700


def test_old_samples_of_a_small_track_are_kept() -> None:
    kept, spans = track(0), []
    one = kept.bytes
    for stamp_ns in range(S // 10, 1200 * S, S // 10):
        kept.append(frame(stamp_ns), 300 * S)
        if kept.bytes > 20 * one:
            kept.shrink_to(15 * one)
        assert kept.time_range is not None
        spans.append(kept.time_range[1] - kept.time_range[0])
    assert min(spans[3000:]) > 50 * S and max(spans) == 300 * S
