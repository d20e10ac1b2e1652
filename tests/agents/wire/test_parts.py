"""The attachments of parts of long replies."""

import pytest

from linked_fleet_agent.wire.parts import PartHead, PartRequest, content_tag, parse_head, parse_request

TAG = "9f86d081884c7d65"
NO_REQUEST = [
    b"", b"part", b"part - 0 0", b"part - -1 5", b"part - 0 5 ", b"part - 0 99999999999", b"part - 0", b"part  0 5",
    b"part 9F86D081884C7D65 0 5", b"part 9f86 0 5", b"part - 0 5\n", b"part - 0 \xd9\xa5",
    b"00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01",
]  # fmt: skip
NO_HEAD = [b"", b"part - 5", b"part 9f86d081884c7d65 -5", b"part 9f86d081884c7d65 5 5", b"part 9f86d081884c7d65 5\n"]


@pytest.mark.parametrize("request_", [PartRequest("", 0, 65536), PartRequest(TAG, 9_999_999_999, 1)])
def test_a_request_is_read_as_it_was_written(request_: PartRequest) -> None:
    assert parse_request(request_.encode()) == request_


@pytest.mark.parametrize("head", [PartHead(TAG, 0), PartHead(TAG, 9_999_999_999)])
def test_a_head_is_read_as_it_was_written(head: PartHead) -> None:
    assert parse_head(head.encode()) == head


@pytest.mark.parametrize("attachment", NO_REQUEST)
def test_other_attachments_ask_for_no_part(attachment: bytes) -> None:
    assert parse_request(attachment) is None


@pytest.mark.parametrize("attachment", NO_HEAD)
def test_other_attachments_are_no_head(attachment: bytes) -> None:
    assert parse_head(attachment) is None


def test_a_tag_tells_contents_apart() -> None:
    assert content_tag(b"test") == TAG
    assert content_tag(b"test ") != TAG
