"""Control of robots with the real fleet, and with a server that answers otherwise."""

import time
from collections.abc import Callable, Iterator

import httpx
import pytest

from linked_fleet_client.action import Action
from linked_fleet_client.control import Control
from linked_fleet_client.errors import ClientError, Controlled, ControlLost, Unsupported
from linked_fleet_client.fleet import Fleet, Thing
from linked_fleet_client.invocation import Invocation
from linked_fleet_client.vocabulary import LF
from shared_fixtures import RunningFleet

pytestmark = pytest.mark.virtual
ROBOTS = ("ur5", "panda")
JOINT = "shoulder_pan_joint"
DURATION_S = 30.0


@pytest.fixture(autouse=True)
def _renewed_by_the_test(monkeypatch: pytest.MonkeyPatch) -> None:
    """Renew only when the test does: a thread knows no virtual time. ``test_control_scripted.py`` has the thread."""
    monkeypatch.setattr(Control, "_renew_repeatedly", lambda control: None)


@pytest.fixture
def here(fleet: RunningFleet) -> Iterator[Fleet]:
    with Fleet(fleet.root) as here:
        yield here


@pytest.fixture
def other(fleet: RunningFleet) -> Iterator[Fleet]:
    with Fleet(fleet.root) as other:
        yield other


@pytest.fixture
def sent(here: Fleet) -> list[httpx.Request]:
    """Return the list of unsafe requests of the client so far."""
    requests: list[httpx.Request] = []

    def note(request: httpx.Request) -> None:
        if request.method != "GET":
            requests.append(request)

    here.web.http.event_hooks = {"request": [note]}
    return requests


def state(fleet: Fleet, robot: str = "ur5") -> str:
    thing = fleet[robot]
    thing.read()
    lease = fleet.web.get(thing.linked_iris(LF.lease)[0])
    return str(lease.graph.value(lease.iri(lease.url), LF.state)).rpartition("#")[2]


def move(fleet: Fleet, robot: str = "ur5", joint: str = JOINT) -> Invocation:
    return fleet[robot][joint].actions["rotate"](value=1, unit="deg")


def test_a_block_has_control_and_gives_it_back(here: Fleet, other: Fleet) -> None:
    with here["ur5"].control("Ada") as control:
        assert state(other) == "held"
        move(here)
        with pytest.raises(Controlled, match="Ada controls ur5 until"):
            move(other)
        with pytest.raises(Controlled, match="Ada"), other["ur5"].control("Bob"):
            raise AssertionError("the lease was taken")
        time.sleep(DURATION_S * 0.9)
        control.renew()
        time.sleep(DURATION_S * 0.9)
        control.check()
        move(here)
    assert state(other) == "free"
    move(other)
    assert here.web.controls == other.web.controls == {}


def test_a_motion_may_be_tied_to_the_lease(here: Fleet) -> None:
    with here["ur5"].control("Ada") as control:
        slow = here["ur5"][JOINT].actions["rotate"]
        run = slow(value=60, unit="deg", speed={"value": 2, "unit": "deg/s"}, tiedTo=control.iri)
    assert run.wait(60) == "cancelled"


FINDINGS: dict[str, Callable[[Fleet], Action]] = {
    "by parts": lambda fleet: fleet["ur5"][JOINT].actions["rotate"],
    "by a path": lambda fleet: fleet.at(f"ur5/{JOINT}").actions["rotate"],  # type: ignore[union-attr]
    "by the world": lambda fleet: fleet["world"]["ur5"][JOINT].actions["rotate"],
    "by the address of the joint": lambda fleet: _thing(fleet, fleet["ur5"][JOINT].iri).actions["rotate"],
    "by its own address": lambda fleet: _action(fleet, fleet["ur5"][JOINT].actions["rotate"].iri),
}


def _thing(fleet: Fleet, iri: str) -> Thing:
    found = fleet.get(iri)
    assert isinstance(found, Thing)
    return found


def _action(fleet: Fleet, iri: str) -> Action:
    found = fleet.get(iri)
    assert isinstance(found, Action)
    return found


@pytest.mark.parametrize("finding", FINDINGS)
def test_the_lock_token_goes_with_the_actions_of_the_robot(
    here: Fleet, sent: list[httpx.Request], finding: str
) -> None:
    """However they were found; not with those of another robot, nor with stops, which need no control."""
    rotate = FINDINGS[finding](here)
    with here["ur5"].control("Ada") as control:
        rotate(value=1, unit="deg")
        assert sent[-1].headers["lock-token"] == control.token
        rotate.rehearse(value=2, unit="deg")
        assert sent[-1].headers["lock-token"] == control.token
        here["panda"]["panda_joint1"].actions["rotate"](value=1, unit="deg")
        assert "lock-token" not in sent[-1].headers
        here["ur5"].actions["stop"]()
        assert "lock-token" not in sent[-1].headers
    rotate(value=1, unit="deg")
    assert "lock-token" not in sent[-1].headers


def _late(control: Control, other: Fleet) -> None:
    time.sleep(DURATION_S + 1)


def _taken(control: Control, other: Fleet) -> None:
    time.sleep(DURATION_S + 1)
    control.until_s = time.monotonic() + DURATION_S  # as if its clock had stood still meanwhile
    bob = other["ur5"].control("Bob")
    bob.__enter__()


def _renewed_late(control: Control, other: Fleet) -> None:
    time.sleep(DURATION_S + 1)
    with pytest.raises(ControlLost, match="ended before"):
        control.renew()


def _refused(control: Control, other: Fleet) -> None:
    _taken(control, other)
    with pytest.raises(ControlLost, match="Bob controls"):
        control.renew()


LOSSES: dict[str, tuple[Callable[[Control, Fleet], None], str, str]] = {
    "not renewed": (_late, "could not be renewed", "free"),
    "taken by another": (_taken, "Bob controls", "held"),
    "renewed too late": (_renewed_late, "ended before", "free"),
    "renewal refused": (_refused, "Bob controls", "held"),
}


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("used", [True, False])
def test_a_lost_lease_is_an_error_of_the_next_motion_and_of_the_block(
    here: Fleet, other: Fleet, sent: list[httpx.Request], loss: str, used: bool
) -> None:
    """No motion is begun without control, the robot can be stopped, and what another client took stays taken."""
    lose, reason, after = LOSSES[loss]
    try:
        with pytest.raises(ControlLost, match=reason), here["ur5"].control("Ada", DURATION_S) as control:
            lose(control, other)
            if used:
                with pytest.raises(ControlLost, match=reason):
                    move(here)
                with pytest.raises(ControlLost, match=reason):
                    control.check()
                assert here["ur5"].actions["stop"]().wait(30) == "succeeded"
        assert state(other) == after
    finally:
        for control in list(other.web.controls.values())[:1]:
            control.__exit__(None, None, None)
    assert state(other) == "free"


def test_an_error_of_the_block_is_not_replaced(here: Fleet) -> None:
    """It has a note about the control that was lost."""
    with pytest.raises(ValueError, match="mine") as raised, here["ur5"].control("Ada", DURATION_S):
        time.sleep(DURATION_S + 1)
        raise ValueError("mine")
    assert "Control of ur5 is lost" in raised.value.__notes__[0]


def test_an_error_of_the_block_gives_control_back(here: Fleet, other: Fleet) -> None:
    with pytest.raises(ValueError, match="mine") as raised, here["ur5"].control("Ada"):
        raise ValueError("mine")
    assert state(other) == "free" and not hasattr(raised.value, "__notes__")


def test_what_is_no_robot_has_no_lease(here: Fleet) -> None:
    for thing in (here, here["ur5"][JOINT]):
        with pytest.raises(Unsupported, match="links no control lease"):
            thing.control("Ada")


def test_control_lost_is_an_error_of_the_client() -> None:
    assert issubclass(ControlLost, ClientError) and issubclass(Controlled, ClientError)
