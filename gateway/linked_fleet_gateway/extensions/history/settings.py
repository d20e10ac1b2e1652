"""Settings of the extension ``history``."""

from dataclasses import dataclass
from typing import ClassVar

from linked_fleet_gateway.base.settings import Section, setting, whole_number


@dataclass(frozen=True)
class HistorySettings(Section):
    prefix: ClassVar[str] = "LINKED_FLEET_HISTORY_"

    s: int = setting(whole_number(0, 86_400), "300", "seconds to keep of each robot; 0: none")
    hz: int = setting(
        whole_number(1, 100),
        "10",
        "samples a second to keep of each robot, at most 100",
    )
    mb: int = setting(
        whole_number(1, 1_000_000),
        "24",
        "memory (MB) of all histories; when it is full, older samples are thinned out",
    )
