"""Messages to people: one for a flapping sensor, one for a fleet that fails, and again if nobody could be reached."""

import asyncio
from pathlib import Path

import pytest

from linked_fleet_gateway.api import NotFound
from linked_fleet_gateway.extensions.faults.fault import Fault, Severity, State, Trouble
from linked_fleet_gateway.extensions.faults.ledger import Change
from linked_fleet_gateway.extensions.faults.messages import LEAST_S, MOST_LISTED, Telling
from linked_fleet_gateway.extensions.faults.notify import Notifier, by_apprise

S = 10**9
HOUR = 3600 * S
OF_APPRISE = pytest.mark.filterwarnings("ignore:'imghdr':DeprecationWarning")
TELLING = Telling("error", 3600.0, "https://fleet.example")


def fault(
    state: State = "confirmed", severity: Severity = "error", *, says: str = "It broke.", told_ns: int = 0
) -> Fault:
    return Fault(Trouble("k", "/panda/", ("panda",), severity, says), state, 1, 1, told_ns=told_ns)


def test_people_are_told_of_what_is_confirmed_and_bad_enough() -> None:
    faults = {
        "a": fault(says="A."), "b": fault("acknowledged"), "c": fault("raised"), "d": fault("cleared"),
        "e": fault(severity="warning"), "f": fault(severity="critical", says="F."),
    }  # fmt: skip
    message = TELLING.message(faults, 0, HOUR)
    assert message is not None
    assert message.faults == ("f", "a")
    assert message.title == "2 faults, the worst: F."
    assert message.text.splitlines() == [
        "critical, /panda/: F.", "error, /panda/: A.", "https://fleet.example/faults"
    ]  # fmt: skip


def test_a_fault_is_told_of_once_in_a_period_and_messages_are_apart() -> None:
    assert TELLING.message({"a": fault(told_ns=HOUR)}, 0, 2 * HOUR - 1) is None
    assert TELLING.message({"a": fault(told_ns=HOUR)}, 0, 2 * HOUR) is not None
    assert TELLING.message({"a": fault()}, HOUR, HOUR + int(LEAST_S * S) - 1) is None
    assert TELLING.message({"a": fault()}, HOUR, HOUR + int(LEAST_S * S)) is not None


def test_a_fleet_that_fails_is_one_message() -> None:
    message = TELLING.message({str(number): fault() for number in range(1000)}, 0, HOUR)
    assert message is not None
    assert len(message.faults) == 1000
    assert len(message.text.splitlines()) == MOST_LISTED + 2
    assert "and 980 more" in message.text


class People:
    """Those who are told; ``reached`` says whether messages arrive."""

    def __init__(self) -> None:
        self.faults = {"a": fault(), "b": fault()}
        self.read = list[str]()
        self.reached = True
        self.leads = True
        self.notifier = Notifier(TELLING, self.send, lambda: self.leads, self.faults, self.change)

    async def send(self, title: str, text: str) -> bool:
        if self.reached:
            self.read.append(title)
        return self.reached

    async def change(self, id: str, change: Change) -> Fault:
        if id not in self.faults:
            raise NotFound("It is gone.")
        self.faults[id] = change(self.faults[id])
        return self.faults[id]


def test_a_message_is_sent_once_and_noted() -> None:
    people = People()

    async def looks() -> None:
        for _ in range(3):
            await people.notifier.look()

    asyncio.run(looks())
    assert len(people.read) == 1
    assert all(each.told_ns for each in people.faults.values())
    assert (people.notifier.sent, people.notifier.failed) == (1, 0)


def test_what_did_not_arrive_is_not_noted_and_others_do_not_send() -> None:
    people = People()
    people.leads = False
    asyncio.run(people.notifier.look())
    people.leads, people.reached = True, False
    asyncio.run(people.notifier.look())
    assert not people.read
    assert not any(each.told_ns for each in people.faults.values())
    assert people.notifier.failed == 1


@OF_APPRISE
@pytest.mark.parametrize(
    ("text", "says"),
    [("", "has 0 addresses"), ("nonsense", "address 1"), ("mailto://a:b@c.example\n#\nx\n", "address 2")],
)
def test_a_file_that_cannot_be_used_is_refused_without_its_secrets(tmp_path: Path, text: str, says: str) -> None:
    file = tmp_path / "people"
    file.write_text(text)
    with pytest.raises(ValueError, match=says) as refused:
        by_apprise(file)
    assert "a:b" not in str(refused.value)


@OF_APPRISE
def test_apprise_understands_the_addresses(tmp_path: Path) -> None:
    file = tmp_path / "people"
    file.write_text("# the shift\nmailto://user:secret@mail.example?to=shift@mail.example\n")
    assert callable(by_apprise(file))
