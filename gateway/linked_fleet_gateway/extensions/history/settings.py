"""Settings of the extension ``history``."""

from dataclasses import dataclass
from typing import ClassVar

from linked_fleet_gateway.base.settings import Section, setting, whole_number


@dataclass(frozen=True)
class HistorySettings(Section):
    prefix: ClassVar[str] = "LINKED_FLEET_HISTORY_"

    s: int = setting(whole_number(0, 86_400), "300", "seconds of each robot that are remembered; 0: none")
    hz: int = setting(
        whole_number(1, 100),
        "10",
        "samples a second of each robot that are remembered, at most 100: not every frame is",
    )
    mb: int = setting(
        whole_number(1, 1_000_000),
        "24",
        "memory (MB) of all histories together; when it is full, the older samples are thinned out",
    )
