"""Contents that an agent keeps while gateways ask for their parts."""

import pytest

from linked_fleet_agent import long_replies
from linked_fleet_agent.long_replies import HELD_S, LongReplies, PartError
from linked_fleet_agent.wire.parts import PartHead, PartRequest, content_tag

CONTENT = b"0123456789"
TAG = content_tag(CONTENT)


class Reader:
    """Counts reads of a content."""

    def __init__(self, content: bytes = CONTENT) -> None:
        self.content, self.count = content, 0

    def __call__(self, query: bytes) -> bytes:
        self.count += 1
        return self.content


def test_the_parts_of_a_content_are_read_once() -> None:
    replies, read = LongReplies(), Reader()
    assert replies.part(b"q", PartRequest("", 0, 4), read) == (b"0123", PartHead(TAG, 10))
    assert replies.part(b"q", PartRequest(TAG, 4, 4), read) == (b"4567", PartHead(TAG, 10))
    assert replies.part(b"q", PartRequest(TAG, 8, 4), read) == (b"89", PartHead(TAG, 10))
    assert (read.count, replies.held_bytes) == (1, 0)


def test_a_part_that_is_no_longer_held_is_read_again_if_the_content_is_the_same() -> None:
    replies, read = LongReplies(), Reader()
    assert replies.part(b"q", PartRequest(TAG, 4, 4), read)[0] == b"4567"
    read.content = b"9876543210"
    with pytest.raises(PartError, match="ask for its first part again"):
        LongReplies().part(b"q", PartRequest(TAG, 4, 4), read)


@pytest.mark.parametrize("asked", [PartRequest("", 11, 1), PartRequest("0" * 16, 0, 1), PartRequest(TAG, 99, 1)])
def test_parts_outside_the_content_are_refused(asked: PartRequest) -> None:
    with pytest.raises(PartError, match="ask for its first part again"):
        LongReplies().part(b"q", asked, Reader())


def test_two_gateways_get_their_own_pictures() -> None:
    replies = LongReplies()
    for content in (b"first picture", b"second picture"):
        replies.part(b"q", PartRequest("", 0, 5), Reader(content))
    for content in (b"first picture", b"second picture"):
        asked = PartRequest(content_tag(content), 5, 99)
        assert replies.part(b"q", asked, Reader(b"third"))[0] == content[5:]


def test_contents_are_forgotten_when_nobody_asks_for_them() -> None:
    now_s = 0.0
    replies = LongReplies(lambda: now_s)
    replies.part(b"q", PartRequest("", 0, 4), Reader())
    now_s = HELD_S / 2
    replies.forget_idle()
    assert replies.held_bytes == 10
    now_s = HELD_S
    replies.forget_idle()
    assert replies.held_bytes == 0


def test_the_memory_of_contents_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(long_replies, "MAX_HELD_BYTES", 25)
    replies = LongReplies()
    for number in range(5):
        replies.part(b"%d" % number, PartRequest("", 0, 4), Reader())
        assert replies.held_bytes <= 25
