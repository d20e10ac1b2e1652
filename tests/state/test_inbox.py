"""The hand-over to the event loop is bounded, and one sender's flood costs no other its place."""

from linked_fleet_state.events import MAX_KEYS, MAX_QUEUED, MAX_QUEUED_OF_ONE, MAX_TOKENS_OF_ONE, Inbox


def test_the_progress_of_one_is_bounded_and_that_of_others_heard() -> None:
    woken = list[int]()
    inbox = Inbox(lambda: woken.append(1))
    inbox.put_progress("quiet", b"first")
    for _ in range(2 * MAX_QUEUED):
        inbox.put_progress("loud", b"more")
    inbox.put_progress("quiet", b"last")
    batch = inbox.take()
    assert [payload for key, payload in batch.progress if key == "quiet"] == [b"first", b"last"]
    assert len(batch.progress) == 2 + MAX_QUEUED_OF_ONE
    assert woken == [1]
    inbox.put_progress("loud", b"again")
    assert list(inbox.take().progress) == [("loud", b"again")]


def test_the_values_of_one_robot_leave_those_of_others_their_place() -> None:
    """Those that come too often are dropped, which the gap in their sequence shows; others are heard in order."""
    inbox = Inbox(lambda: None)
    inbox.put_of_components("quiet/values", b"first")
    for _ in range(2 * MAX_QUEUED):
        inbox.put_of_components("loud/values", b"more")
    inbox.put_of_components("quiet/values", b"last")
    heard = inbox.take().of_components
    assert [payload for key, payload in heard if key == "quiet/values"] == [b"first", b"last"]
    assert len(heard) == 2 + MAX_QUEUED_OF_ONE


def test_the_latest_state_of_each_key_is_kept() -> None:
    inbox = Inbox(lambda: None)
    for number in range(2 * MAX_KEYS):
        inbox.put_state("loud", b"%d" % number)
        inbox.put_state(f"key-{number}", b"")
    batch = inbox.take()
    assert batch.states["loud"] == b"%d" % (2 * MAX_KEYS - 1)
    assert len(batch.states) == MAX_KEYS


def test_tokens_of_one_robot_leave_those_of_others_their_place() -> None:
    inbox = Inbox(lambda: None)
    for run in range(2 * MAX_KEYS):
        inbox.put_presence(f"fleet/robot/loud/presence/{run}", True)
    inbox.put_presence("fleet/robot/quiet/presence/1", True)
    inbox.put_presence("fleet/robot/loud/presence/0", False)
    batch = inbox.take()
    assert (len(batch.presence), batch.presence["fleet/robot/quiet/presence/1"]) == (MAX_TOKENS_OF_ONE + 1, True)
    assert batch.presence["fleet/robot/loud/presence/0"] is False
    assert batch.presence_lost
