"""How the gateway's Zenoh session is set up, and what is said when it does not open. Pure."""

LEASE_MS = 2_500


def settings(listen: tuple[str, ...], connect: tuple[str, ...]) -> dict[str, object]:
    """Router mode, because a peer hears no other peer through a router and a client cannot open without one."""
    return {
        "mode": "router",
        "listen/endpoints": list(listen),
        "listen/exit_on_failure": True,
        "connect/endpoints": list(connect),
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "connect/retry": {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 1.5},
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/link/tx/lease": LEASE_MS,
    }


def port_is_taken(error: Exception) -> bool:
    return "os error 98" in str(error)


def open_failure(error: Exception, listen: tuple[str, ...]) -> str:
    """One line for a human."""
    if port_is_taken(error):
        return f"a port of {', '.join(listen)} is taken by another process"
    return f"Zenoh does not open: {str(error).splitlines()[0].partition(' at /')[0]}"
