"""Feedback and results in progress: what is no JSON, or too long, costs the report its part and not its state."""

import pytest
from msgspec import UNSET, Raw

from linked_fleet_agent.wire.components import MAX_FEEDBACK_BYTES, MAX_RESULT_BYTES, without_unusable_parts
from linked_fleet_agent.wire.messages import Progress


@pytest.mark.parametrize(
    ("part", "payload", "said"),
    [
        ("result", b'{"width": 0.03}', ""),
        ("result", b"1e999", "the result is no JSON"),
        ("result", b'"\xff"', "the result is no JSON"),
        ("feedback", b"[" * 100_000, "the feedback has 100000 bytes"),
        ("feedback", b"[" * MAX_FEEDBACK_BYTES, "the feedback is no JSON"),
        ("result", b'{"a": [{"b": [1]}]}', ""),
        ("result", b'{"a": [{"b": [{}]}]}', "the result is nested more than 4 deep"),
        ("feedback", b"[" * 900 + b"]" * 900, "the feedback is nested more than 4 deep"),
        ("result", b'"' + b"a" * MAX_RESULT_BYTES + b'"', f"{MAX_RESULT_BYTES} is the maximum"),
    ],
)
def test_a_part_that_cannot_be_used_is_left_out_with_a_sentence(part: str, payload: bytes, said: str) -> None:
    progress = Progress(version=1, id="a", incarnation=1, state="succeeded", wall_ns=1, **{part: Raw(payload)})
    kept, problem = without_unusable_parts(progress)
    assert said in problem and bool(said) == bool(problem)
    assert (getattr(kept, part) is UNSET) == bool(said)
    assert kept.state == "succeeded"
