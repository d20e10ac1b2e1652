"""The settings of the earlier run for a folder, read from the files that it wrote."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from linked_fleet_agent.wire.keys import Keys, unescape

_AGENT = "agent "  # before the common name, in the ids of rules (linked_fleet_agent.wire.trust)
Robots = tuple[str, ...] | None
"""The robots that an agent may use; None: any."""


@dataclass(frozen=True)
class EarlierRun:
    """Settings that a run keeps unless its options give others; empty if there was no earlier run."""

    namespace: str = ""
    agents: Mapping[str, Robots] = field(default_factory=dict)
    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    installed: Path | None = None


def read_earlier_run(folder: Path) -> EarlierRun:
    """Return the settings in ``access.json`` and ``router.json5``. Raises ValueError for a file of another form."""
    access, router = _json(folder / "access.json"), _json(folder / "router.json5")
    try:
        if access is None and router is not None:
            access = router["access_control"]
        namespace, agents = ("", {}) if access is None else _granted(access)
        if router is None:
            return EarlierRun(namespace, agents)
        authority = Path(router["transport"]["link"]["tls"]["root_ca_certificate"])
        listen, connect = (tuple(map(str, router[kind]["endpoints"])) for kind in ("listen", "connect"))
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise ValueError(
            f"{folder}: access.json or router.json5 has another form than this script writes ({error!r}); "
            "mend it, or move both away and name all agents"
        ) from error
    return EarlierRun(namespace, agents, listen, connect, authority.parent)


def _json(path: Path) -> dict[str, Any] | None:
    try:
        found = json.loads(path.read_text())
    except FileNotFoundError:
        return None
    except ValueError as error:
        raise ValueError(f"{path} is no JSON ({error}); mend it, or move it away and name all agents") from error
    if not isinstance(found, dict):
        raise ValueError(f"{path} is no JSON object; mend it, or move it away and name all agents")  # noqa: TRY004
    return found


def _granted(access: Mapping[str, Any]) -> tuple[str, dict[str, Robots]]:
    """Return the namespace, and the robots of each agent."""
    keys = {rule["id"]: rule["key_exprs"] for rule in access["rules"]}
    namespace = str(keys["out"][0]).removesuffix("/**")
    return namespace, dict(_robots(Keys(namespace), keys))


def _robots(keys: Keys, rules: Mapping[str, list[str]]) -> Iterator[tuple[str, Robots]]:
    before, behind = keys.all_of_robots.split("*", 1)
    for id, granted in rules.items():
        if id.startswith(_AGENT):
            chunks = [key.removeprefix(before).removesuffix(behind) for key in granted]
            yield unescape(id.removeprefix(_AGENT)), None if "*" in chunks else tuple(map(unescape, chunks))
