"""How well the frames of a robot arrive is judged by their sequence numbers and by silence."""

import pytest

from linked_fleet_agent.wire.codec import encode_state
from linked_fleet_agent.wire.messages import State
from linked_fleet_state.events import Framed
from mirrored_fleet import MirroredFleet

SECOND_NS = 1_000_000_000
T0_NS = 1_750_000_000 * SECOND_NS
HZ = 10


class Sender:
    """Sends ten frames a second, of which some are lost."""

    def __init__(self) -> None:
        self.mirrored = MirroredFleet()
        self.mirrored.describe("r")
        self.run, self.sequence, self.now_ns = 1, 0, T0_NS
        self.judge()

    @property
    def quality(self) -> str | None:
        return self.mirrored.fleet.robots["r"].link_quality

    def judge(self) -> None:
        self.mirrored.fleet.check_reception("r", self.now_ns)

    def send(self, seconds: int, *, lost_of_ten: int = 0, sent: bool = True) -> None:
        for number in range(seconds * HZ):
            self.sequence += sent
            self.now_ns += SECOND_NS // HZ
            if sent and number % 10 >= lost_of_ten:
                still = (0.0, 0.0)
                state = State(
                    incarnation=self.run, sequence=self.sequence, monotonic_ns=1, wall_ns=1,
                    positions=still, velocities=still, efforts=still,
                )  # fmt: skip
                self.mirrored.fleet.apply(Framed("r", encode_state(state)), self.now_ns)
            self.judge()


@pytest.mark.parametrize(("lost_of_ten", "quality"), [(0, "linkGood"), (1, "linkWeak"), (5, "linkWeak")])
def test_lost_frames_make_a_link_weak(lost_of_ten: int, quality: str) -> None:
    sender = Sender()
    assert sender.quality is None
    sender.send(3, lost_of_ten=lost_of_ten)
    assert sender.quality == quality
    sender.send(12)
    assert sender.quality == "linkGood"


def test_silence_is_a_lost_link_until_frames_come_again() -> None:
    sender = Sender()
    sender.send(3)
    sender.send(4, sent=False)
    assert sender.quality == "linkLost"
    sender.send(2)
    assert sender.quality == "linkGood"


def test_a_change_is_told_once_and_an_offline_robot_has_no_link() -> None:
    sender = Sender()
    sender.send(2)
    assert sender.mirrored.fleet.check_reception("r", sender.now_ns) is None
    robot = sender.mirrored.fleet.robots["r"]
    robot.set_online(False)
    assert sender.mirrored.fleet.check_reception("r", sender.now_ns) is not None
    assert sender.quality is None
