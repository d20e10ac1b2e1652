"""Who may do what to which robots."""

import pytest

from linked_fleet_identity.rights import ALL, EVERYBODY, NOBODY, Grant, Identity, Right, View


def identity(*grants: tuple[str, tuple[str, ...]]) -> Identity:
    """Return an identity with the rights of each grant, for robots that match its patterns."""
    return Identity("ada", tuple(Grant(frozenset(map(Right, rights.split())), robots) for rights, robots in grants))


@pytest.mark.parametrize("right", Right)
def test_everybody_may_do_everything_and_nobody_nothing(right: Right) -> None:
    assert EVERYBODY.has_right(right, "ur5") and EVERYBODY.has_right(right, None)
    assert not NOBODY.has_right(right, "ur5") and not NOBODY.has_right(right, None)


def test_to_act_is_to_stop_and_nothing_else_includes_anything() -> None:
    given = {"read": {"read"}, "subscribe": {"subscribe"}, "stop": {"stop"}, "act": {"act", "stop"}, "admin": {"admin"}}
    for name, expected in given.items():
        assert {right.value for right in Right if identity((name, ("*",))).has_right(right, "ur5")} == expected


def test_patterns_are_of_whole_names_and_case_counts() -> None:
    visible = identity(("read", ("lab-*", "ur?"))).visible_robots
    names = ("lab-1", "lab-", "ur5", "Lab-1", "my-lab-1", "ur10", "lab")
    assert [name for name in names if visible.includes(name)] == ["lab-1", "lab-", "ur5"]
    assert identity(("read", ("lab-*",))).visible_robots.includes("lab-1\nhall")  # whatever characters a name has


def test_rights_of_several_grants_stay_apart() -> None:
    who = identity(("read", ("*",)), ("act", ("lab-*",)))
    assert (
        who.has_right(Right.READ, "hall") and not who.has_right(Right.ACT, "hall") and who.has_right(Right.ACT, "lab-1")
    )


def test_rights_on_one_robot_suffice_for_the_fleet_except_administration() -> None:
    assert identity(("read stop admin", ("lab-*",))).has_right(Right.STOP, None)
    assert not identity(("read stop admin", ("lab-*",))).has_right(Right.ADMIN, None)
    assert identity(("admin", ("*",))).has_right(Right.ADMIN, None)


@pytest.mark.parametrize(
    ("rights", "robot", "may"),
    [
        ("subscribe admin", "lab-1", True),
        ("admin subscribe", "lab-1", True),
        ("subscribe", "hall", False),
        ("act stop", "lab-1", False),
        ("subscribe", None, True),
        ("", "lab-1", False),
    ],
)
def test_one_of_several_rights_is_enough(rights: str, robot: str | None, may: bool) -> None:
    """In any order, for that robot."""
    who = identity(("read subscribe", ("lab-*",)))
    assert who.has_any_right(map(Right, rights.split()), robot) is may


def test_views_of_everything_are_equal() -> None:
    assert identity(("read", ("lab-*", "*"))).visible_robots is ALL
    assert View.of(frozenset({"a"}), "ada") is View.of(frozenset({"a"}), "ada")
    # Each also has invocations of the fleet.
    assert View.of(frozenset({"a"}), "ada") != View.of(frozenset({"a"}), "bob")
    assert identity(("read", ("a",))).visible_robots == View.of(frozenset({"a"}), "ada")


def test_unknown_callers_have_no_name() -> None:
    """Callers are counted and audited by name, or without a name by address."""
    assert (EVERYBODY.name, NOBODY.name, ALL.name) == ("", "", "")


def test_an_identity_lasts_unless_it_says_otherwise() -> None:
    assert (EVERYBODY.expires_ns, EVERYBODY.credential) == (None, None)


def test_a_view_covers_another_by_its_patterns() -> None:
    """Otherwise a caller who may subscribe to fewer robots than it may read would get all of them through the fleet."""
    assert identity(("read subscribe", ("lab-*",))).visible_robots.is_superset_of(View.of(frozenset({"lab-*"}), "x"))
    assert ALL.is_superset_of(View.of(frozenset({"lab-*"}), "x"))
    both = identity(("read", ("*",)), ("subscribe", ("lab-*",)))
    assert not both.view_for(Right.SUBSCRIBE).is_superset_of(both.visible_robots)
