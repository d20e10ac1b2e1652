"""Settings of the extension ``rules``."""

from dataclasses import dataclass
from typing import ClassVar

from linked_fleet_gateway.base.settings import Section, setting, whole_number


@dataclass(frozen=True)
class RuleSettings(Section):
    prefix: ClassVar[str] = "LINKED_FLEET_RULES_"

    per_client: int = setting(whole_number(), "50", "rules of one client")
