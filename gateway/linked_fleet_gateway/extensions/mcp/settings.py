"""The section of the extension ``mcp``."""

from dataclasses import dataclass
from typing import ClassVar

from linked_fleet_gateway.base.settings import Section, setting, whole_number


@dataclass(frozen=True)
class McpSettings(Section):
    prefix: ClassVar[str] = "LINKED_FLEET_MCP_"

    sessions: int = setting(whole_number(1, 10_000), "200", "sessions of the Model Context Protocol at once")
    sessions_per_client: int = setting(
        whole_number(1, 10_000), "20", "sessions of one client (an identity, else an address)"
    )
    idle_s: int = setting(whole_number(1, 86_400), "600", "seconds without a request until a session ends")
