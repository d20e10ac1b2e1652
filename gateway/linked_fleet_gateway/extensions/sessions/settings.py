"""Settings of the extension ``sessions``."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from linked_fleet_gateway.base.settings import FILE, Section, setting


@dataclass(frozen=True)
class SessionSettings(Section):
    prefix: ClassVar[str] = "LINKED_FLEET_SESSION_"

    key_file: Path | None = setting(
        FILE, "", "key of browser sessions, 32 bytes in base64; empty: made once and kept in Redis"
    )
