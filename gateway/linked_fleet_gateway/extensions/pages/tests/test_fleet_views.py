"""The table of the fleet: what its address asks for, its order, its heads and its pages."""

from collections.abc import Sequence

import pytest

from linked_fleet_gateway.extensions.pages.fleet_views import CARDS, ROWS, RobotCard, read_choice
from linked_fleet_gateway.extensions.pages.thing_views import Presence
from linked_fleet_gateway.extensions.pages.values import Link, State, Time


def card(name: str, state: str = "online", **more: object) -> RobotCard:
    known = {
        "task": "", "moving": False, "moved": None, "holder": "", "out_of_service": "", "stopped": "", "battery": "",
        "quality": "good", "tags": (), "trouble": "", "severity": "", "faults": 0, "thumbnail": "", "model": "arm",
    }  # fmt: skip
    link = Link(name, f"http://x/{name}/", f"http://x/{name}/")
    return RobotCard(link=link, name=name, presence=Presence(State(state), None, ""), **(known | more))  # type: ignore[arg-type]


def names(query: str, robots: Sequence[RobotCard]) -> str:
    return " ".join(each.name for each in read_choice(query).sorted(robots))


def test_robots_with_trouble_come_first_by_default() -> None:
    robots = [card("a"), card("b", "offline"), card("c", severity="warning"), card("d", severity="critical"), card("e")]
    assert names("", robots) == "d b c a e"
    assert names("sort=name", robots) == "a b c d e"
    assert names("sort=name&order=descending", robots) == "e d c b a"


@pytest.mark.parametrize(
    ("query", "order"),
    [
        ("sort=battery", "c a b"),
        ("sort=battery&order=descending", "a c b"),
        ("sort=link", "b a c"),
        ("sort=tags", "c a b"),
        ("sort=moved", "b c a"),
        ("sort=doing", "a b c"),
        ("sort=holder&order=descending", "a b c"),
    ],
)
def test_what_is_unknown_is_last_in_both_directions(query: str, order: str) -> None:
    robots = [
        card("a", battery="90", tags=("hall 3",), moving=True, task="rotate", holder="Ada"),
        card("b", quality="lost", moved=Time("", "2026-01-01T00:00:00Z")),
        card("c", battery="9", tags=("arms",), moved=Time("", "2026-01-02T00:00:00Z")),
    ]
    assert names(query, robots) == order


def test_heads_link_the_other_direction_and_keep_the_filter() -> None:
    heads = {each.title: each for each in read_choice("view=table&sort=battery&tag=hall 3&page=2").heads()}
    assert [each.sorted for each in heads.values() if each.sorted] == ["ascending"]
    assert heads["Battery"].href == "/?view=table&sort=battery&order=descending&tag=hall+3"
    assert heads["Connection"].href == "/?view=table&sort=link&tag=hall+3"


@pytest.mark.parametrize(
    ("query", "said"),
    [
        ("sort=weight", "There is no sort 'weight'"),
        ("view=list", "There is no view 'list'; it can be cards, table."),
        ("presence=<b>", "There is no presence '<b>'"),
        ("page=-1", "There is no page '-1'"),
        ("view=table&sort=link&order=descending", ""),
    ],
)
def test_what_the_address_asks_for_in_vain_is_said(query: str, said: str) -> None:
    choice = read_choice(query)
    assert choice.note.startswith(said) and bool(choice.note) == bool(said)


@pytest.mark.parametrize(
    ("asked", "fits"),
    [
        ({"text": "ARM hall"}, True),
        ({"text": "leg"}, False),
        ({"tag": "hall 3"}, True),
        ({"tag": "hall"}, False),
        ({"presence": "offline"}, False),
        ({"kind": "arm", "presence": "online"}, True),
    ],
)
def test_filters(asked: dict[str, str], fits: bool) -> None:
    assert card("a", tags=("hall 3",)).fits(asked) is fits


def test_the_table_has_pages() -> None:
    robots = [card(f"r{number}") for number in range(ROWS + 1)]
    first, last = read_choice("view=table").rows(robots), read_choice("view=table&page=9").rows(robots)
    assert (len(first.robots), first.following, first.former) == (ROWS, "/?view=table&page=2", "")
    assert (len(last.robots), last.begin, last.following, last.former) == (1, ROWS, "", "/?view=table&page=1")


def test_cards_of_a_large_fleet_have_pages_of_those_that_fit() -> None:
    robots = [card(f"r{number}", tags=("hall",)) for number in range(CARDS + 1)]
    few, many = read_choice("").paged(CARDS), read_choice("").paged(CARDS + 1)
    assert (few, many, read_choice("view=table").paged(1)) == (False, True, True)
    first = read_choice("tag=hall").rows(robots)
    assert (len(first.robots), first.count, first.following) == (CARDS, CARDS + 1, "/?tag=hall&page=2")
    assert len(read_choice("tag=hall&page=2").rows(robots).robots) == 1
