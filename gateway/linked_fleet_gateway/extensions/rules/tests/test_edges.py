"""When a pattern starts to hold, by its rows before and now."""

import pytest
from pyoxigraph import BlankNode, Literal, NamedNode

from linked_fleet_gateway.extensions.rules.edges import MOST_ROWS, UnusableResult, edge, ripe, rows_by_key

ONE = {"arm": NamedNode("http://fleet/one"), "angle": Literal(1.0)}
OTHER = {"arm": NamedNode("http://fleet/other"), "angle": Literal(1.0)}


def test_a_row_begins_once_and_again_after_it_ended() -> None:
    now = rows_by_key([ONE])
    assert [row for _, row in edge(set(), now).began] == [ONE]
    assert not edge(set(now), now)
    assert edge(set(now), {}).ended == tuple(now)
    assert edge(set(), now).began


def test_rows_begin_one_by_one() -> None:
    before = set(rows_by_key([ONE]))
    change = edge(before, rows_by_key([OTHER, ONE]))
    assert [row for _, row in change.began] == [OTHER] and not change.ended


@pytest.mark.parametrize(
    ("before", "since_s", "holds_for_s", "kept", "due_s"),
    [
        ([], [10.0, 10.0], 0.0, [0, 1], None),
        ([], [10.0, 8.0], 5.0, [], 13.0),
        ([], [5.0, 8.0], 5.0, [0], 13.0),
        ([1], [10.0, 10.0], 5.0, [1], 15.0),
        ([0, 1], [10.0, 10.0], 5.0, [0, 1], None),
    ],
    ids=["at once", "both wait", "one is ripe", "one held before", "both held before"],
)
def test_rows_are_ripe_after_a_time(
    before: list[int], since_s: list[float], holds_for_s: float, kept: list[int], due_s: float | None
) -> None:
    keys = list(now := rows_by_key([ONE, OTHER]))
    since = dict(zip(keys, since_s, strict=True))
    found, due = ripe(now, {keys[each] for each in before}, since, 10.0, holds_for_s)
    assert (list(found), due) == ([keys[each] for each in kept], due_s)


def test_the_order_of_an_answer_does_not_matter() -> None:
    assert list(rows_by_key([ONE, OTHER])) == list(rows_by_key([OTHER, ONE]))


def test_rows_are_compared_by_the_selected_variables() -> None:
    turned = {**ONE, "angle": Literal(2.0)}
    assert edge(set(rows_by_key([ONE])), rows_by_key([turned])).began
    assert not edge(set(rows_by_key([ONE], ("arm",))), rows_by_key([turned], ("arm",)))
    assert len(rows_by_key([turned, ONE], ("arm",))) == 1


def test_terms_that_are_written_alike_are_not_the_same() -> None:
    values = [Literal("1"), Literal(1), NamedNode("http://fleet/one"), Literal("http://fleet/one")]
    assert len(rows_by_key([{"x": value} for value in values])) == len(values)


@pytest.mark.parametrize(
    "rows",
    [[{"x": BlankNode()}], [{"x": Literal("x" * 10_000)}], [{"x": Literal(n)} for n in range(MOST_ROWS + 1)]],
    ids=["blank", "long", "many"],
)
def test_rows_that_cannot_be_compared_are_refused(rows: list[dict[str, Literal]]) -> None:
    with pytest.raises(UnusableResult):
        rows_by_key(rows)
