"""Configuration of the gateway's Zenoh session, and messages for failures to open it. Pure."""

import json
from collections.abc import Mapping
from pathlib import Path

from linked_fleet_agent.wire.transport import GATEWAY_LEASE_MS, TRANSPORT
from linked_fleet_agent.wire.trust import Credentials


def trust(credentials: Credentials | None, access_file: str) -> dict[str, object]:
    """Return the settings of mutual TLS and access control. Raises ValueError for an unusable file."""
    values = credentials.configuration() if credentials is not None else {}
    if access_file:
        try:
            values["access_control"] = json.loads(Path(access_file).read_text())
        except OSError as error:
            raise ValueError(f"LINKED_FLEET_ZENOH_ACCESS: {access_file} cannot be read: {error.strerror}") from None
        except ValueError as error:
            raise ValueError(f"LINKED_FLEET_ZENOH_ACCESS: {access_file} is no JSON: {error}") from None
    return values


def settings(listen: tuple[str, ...], connect: tuple[str, ...], trust: Mapping[str, object]) -> dict[str, object]:
    """Return the session settings.

    Router mode, because a peer receives nothing from other peers through a router, and a client cannot open without a
    router.
    """
    return {
        **TRANSPORT,
        **trust,
        "mode": "router",
        "listen/endpoints": list(listen),
        "listen/exit_on_failure": True,
        "connect/endpoints": list(connect),
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "connect/retry": {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 1.5},
        "scouting/gossip/enabled": False,
        "transport/link/tx/lease": GATEWAY_LEASE_MS,
    }


def port_is_taken(error: Exception) -> bool:
    return "os error 98" in str(error)


def open_failure(error: Exception, listen: tuple[str, ...]) -> str:
    """Return one line for people."""
    if port_is_taken(error):
        return f"a port of {', '.join(listen)} is taken by another process"
    return f"Zenoh does not open: {str(error).splitlines()[0].partition(' at /')[0]}"
