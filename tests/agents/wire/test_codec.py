"""JSON ↔ messages: round trips, versions, and every malformed payload refused as a WireError and nothing else."""

import contextlib
import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.codec import MAX_JOINTS, VersionError, WireError
from linked_fleet_agent.wire.messages import (
    WIRE_VERSION,
    Accepted,
    Command,
    Description,
    Expectation,
    Follow,
    Move,
    Progress,
    Refused,
    Stop,
)

KINDS: tuple[Any, ...] = (Description, Command, Stop, Progress)


def command(**changes: object) -> dict[str, object]:
    whole: dict[str, object] = {
        "version": WIRE_VERSION,
        "id": "a-1",
        "incarnation": 1,
        "seen_ns": 2,
        "time_to_live_ns": 3,
        "motion": {"type": "move", "targets": {"hinge": 0.5}},
    }
    return whole | changes


DESCRIPTION = Description(
    version=WIRE_VERSION,
    robot="door",
    incarnation=1,
    title="Door",
    urdf="<robot/>",
    joints=("hinge",),
    rate_hz=100.0,
    layout=codec.layout(1, False),
)


class TestMessages:
    @pytest.mark.parametrize(
        "message",
        [
            DESCRIPTION,
            Command(version=1, id="a", incarnation=1, seen_ns=0, time_to_live_ns=1, motion=Move({"hinge": -0.5})),
            Command(
                version=1,
                id="a",
                incarnation=1,
                seen_ns=0,
                time_to_live_ns=1,
                motion=Follow(("a", "b"), (0.5, 1.0), ((1.0, 2.0), (0.0, -1.0))),
                scale=0.25,
                expects={"a": Expectation(0.5, 0.0)},
                rehearsal=True,
            ),
            Stop(version=1, id="s", joints=("hinge",), command="a", reason="enough", rehearsal=True),
            Stop(version=1, id="s"),
            Progress(version=1, id="a", incarnation=1, state="running", wall_ns=5),
            Progress(
                version=1, id="a", incarnation=1, state="failed", wall_ns=5, reason="stuck", positions={"hinge": 1.0}
            ),
        ],
    )
    def test_a_message_comes_back(self, message: Any) -> None:
        assert codec.decode(codec.encode(message), type(message)) == message

    @pytest.mark.parametrize(
        "reply", [Accepted("a-1"), Accepted("a-1", 1.5, ("b", "c"), 2**63 - 1), Refused("", "malformed", "not JSON")]
    )
    def test_a_reply_comes_back(self, reply: Accepted | Refused) -> None:
        assert codec.decode_reply(codec.encode(reply)) == reply

    @pytest.mark.parametrize("kind", KINDS)
    @pytest.mark.parametrize("version", [-1, 0, WIRE_VERSION + 1])
    def test_another_version_is_refused_before_anything_else_is_judged(self, version: int, kind: Any) -> None:
        payload = json.dumps({"version": version, "of": "another time"}).encode()
        with pytest.raises(VersionError, match=f"version {version} is not supported"):
            codec.decode(payload, kind)

    @pytest.mark.parametrize(
        "changes",
        [
            {"id": ""},
            {"id": "a" * 65},
            {"id": "a b"},
            {"id": "a\n"},
            {"incarnation": -1},
            {"incarnation": 2**63},
            {"seen_ns": None},
            {"time_to_live_ns": 0},
            {"time_to_live_ns": 60_000_000_001},
            {"motion": {"type": "move", "targets": {}}},
            {"motion": {"type": "move", "targets": {"": 0.0}}},
            {"motion": {"type": "move", "targets": {"hinge": None}}},
            {"motion": {"type": "move", "targets": {"hinge": "0.5"}}},
            {"motion": {"type": "move", "targets": {f"j{i}": 0.0 for i in range(257)}}},
            {"motion": {"type": "jump", "targets": {"hinge": 0.0}}},
            {"motion": {"type": "move", "targets": {"hinge": 0.0}, "unless": "a person is near"}},
            {"unless": "a person is near"},
            {"motion": {"type": "move", "targets": {"hinge": 0.0}, "speeds": {"hinge": 0.0}}},
            {"motion": {"type": "follow", "joints": [], "times_s": [1.0], "positions": [[]]}},
            {"motion": {"type": "follow", "joints": ["hinge"], "times_s": [0.0], "positions": [[0.0]]}},
            {"motion": {"type": "follow", "joints": ["hinge"], "times_s": [3601.0], "positions": [[0.0]]}},
            {"motion": {"type": "follow", "joints": ["hinge"], "times_s": [1.0] * 1001, "positions": [[0.0]]}},
            {"motion": {"type": "follow", "joints": ["hinge"], "times_s": [1.0], "positions": [[None]]}},
            {"scale": 0.0},
            {"scale": 1.01},
            {"expects": {"hinge": {"position": 0.0}}},
            {"expects": {"hinge": {"position": 0.0, "tolerance": -0.1}}},
            {"rehearsal": "no"},
            {"version": "1"},
            {"version": True},
        ],
    )
    def test_a_command_out_of_bounds_is_refused(self, changes: dict[str, object]) -> None:
        codec.decode(json.dumps(command()).encode(), Command)
        with pytest.raises(WireError):
            codec.decode(json.dumps(command(**changes)).encode(), Command)

    @pytest.mark.parametrize(
        "changes",
        [
            {"id": ""},
            {"joints": None},
            {"joints": [""]},
            {"joints": ["j"] * 1025},
            {"command": "x" * 65},
            {"reason": "x" * 513},
            {"gently": True},
        ],
    )
    def test_a_stop_out_of_bounds_is_refused(self, changes: dict[str, object]) -> None:
        whole = {"version": 1, "id": "s"}
        codec.decode(json.dumps(whole).encode(), Stop)
        with pytest.raises(WireError):
            codec.decode(json.dumps(whole | changes).encode(), Stop)

    @pytest.mark.parametrize("number", ["-1", "9223372036854775808", "123456789012345678901234567890", "1.5", "1e30"])
    def test_invalid_times_are_refused(self, number: str) -> None:
        """Below zero or beyond 63 bits, it is no valid time."""
        told = Progress(version=1, id="a", incarnation=1, state="succeeded", wall_ns=2**63 - 1)
        payload = codec.encode(told)
        assert codec.decode(payload, Progress) == told
        with pytest.raises(WireError, match="wall_ns"):
            codec.decode(payload.replace(b"9223372036854775807", number.encode()), Progress)
        accepted = codec.encode(Accepted("a", at_ns=5))
        assert codec.decode_reply(accepted) == Accepted("a", at_ns=5)
        with pytest.raises(WireError, match="at_ns"):
            codec.decode_reply(accepted.replace(b'"at_ns":5', b'"at_ns":' + number.encode()))

    @pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999", "-1e999"])
    def test_a_target_that_is_no_number_is_refused(self, number: str) -> None:
        payload = json.dumps(command()).replace("0.5", number).encode()
        with pytest.raises(WireError):
            codec.decode(payload, Command)

    @pytest.mark.parametrize(
        "changes",
        [
            {"robot": ""},
            {"robot": "x" * 129},
            {"rate_hz": 0},
            {"rate_hz": 10_001},
            {"base": "loose"},
            {"joints": [f"j{index}" for index in range(MAX_JOINTS + 1)]},
            {"layout": [{"name": "x", "type": "float64", "offset": 0, "count": 1}] * 65},
            {"layout": [{"name": "x", "type": "complex", "offset": 0, "count": 1}]},
            {"urdf": "x" * 8_000_001},
            {"annotations": "x" * 65_537},
            {"tolerances": {"hinge": 0.0}},
            {"tolerances": {"hinge": 1.1}},
            {"tolerances": {"hinge": None}},
            {"tolerances": {f"j{index}": 0.1 for index in range(MAX_JOINTS + 1)}},
        ],
    )
    def test_a_description_out_of_bounds_is_refused(self, changes: dict[str, object]) -> None:
        whole = json.loads(codec.encode(DESCRIPTION))
        with pytest.raises(WireError):
            codec.decode(json.dumps(whole | changes).encode(), Description)

    def test_a_description_of_an_earlier_release_has_no_tolerances(self) -> None:
        said = json.loads(codec.encode(DESCRIPTION))
        del said["tolerances"]
        assert codec.decode(json.dumps(said).encode(), Description) == DESCRIPTION

    @pytest.mark.parametrize("kind", [Description, Progress])
    def test_an_unknown_field_of_news_is_ignored(self, kind: Any) -> None:
        message = (
            DESCRIPTION
            if kind is Description
            else Progress(version=1, id="a", incarnation=1, state="running", wall_ns=5)
        )
        payload = json.dumps(json.loads(codec.encode(message)) | {"weather": "fine"}).encode()
        assert codec.decode(payload, kind) == message

    @pytest.mark.parametrize(
        "payload",
        [
            b"",
            b"\xff\xfe",
            b'"\xff"',
            b"null",
            b"[]",
            b"{}",
            b'{"version":',
            b'{"version":1}{}',
            b'{"version":1e999}',
            b'{"version":' + b"9" * 5000 + b"}",
            b"[" * 100_000,
            b'{"version":1,"x":' + b"[" * 100_000,
            b'{"type":"accepted","id":"a","x":' + b"[" * 100_000,
            b'{"type":"accepted","id":"\\ud800"}',
            b'{"version":1,"id":"\\ud800"}',
        ],
    )
    def test_invalid_messages_are_refused(self, payload: bytes) -> None:
        for kind in KINDS:
            with pytest.raises(WireError):
                codec.decode(payload, kind)
        with pytest.raises(WireError):
            codec.decode_reply(payload)

    @given(
        st.binary(max_size=300)
        | st.recursive(
            st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
            lambda inner: (
                st.lists(inner, max_size=4)
                | st.dictionaries(
                    st.sampled_from(["version", "id", "type", "motion", "targets", "x"]), inner, max_size=5
                )
            ),
        ).map(lambda value: json.dumps(value).encode())
    )
    def test_noise_is_refused_or_a_message(self, payload: bytes) -> None:
        for kind in KINDS:
            with contextlib.suppress(WireError):
                codec.decode(payload, kind)
        with contextlib.suppress(WireError):
            codec.decode_reply(payload)
