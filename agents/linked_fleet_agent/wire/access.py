"""Zenoh access control derived from one list of robots (PROTOCOL.md, "Trust"). Pure.

A neighbour is identified by the common name of its certificate, and its incoming messages are filtered. Messages that
were let in may go out to everybody who has a name.
"""

from collections.abc import Iterable, Mapping, Sequence

from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.wire.names import escape

GATEWAY, ROUTER = "gateway", "router"
"""Common names of gateways and of routers. All gateways share one, all routers the other, each with its own key."""

_PUBLISHING = ("put", "reply", "declare_queryable", "liveliness_token")
_WATCHING = ("liveliness_query", "declare_liveliness_subscriber")
_EVERYTHING = (*_PUBLISHING, *_WATCHING, "delete", "query", "declare_subscriber")
_ASKED = ("description", "command", "stop", "mesh", "picture")


def common_name(agent: str) -> str:
    """Return the common name of an agent's certificate.

    Raises ValueError for a name reserved for gateways or routers.
    """
    if agent in (GATEWAY, ROUTER):
        raise ValueError(f"an agent's certificate cannot be called {agent!r}: whoever has that is taken for one")
    return escape(agent)


def of_router(keys: Keys, agents: Mapping[str, Iterable[str] | None]) -> dict[str, object]:
    """Return ``access_control`` of a router, or of a gateway that agents connect to.

    ``agents`` maps the name in each agent certificate to its robots; None means any robot, as for simulations of robots
    whose names are not known in advance.
    """
    names = [common_name(agent) for agent in agents]
    access = _Access()
    access.grant("out", [GATEWAY, ROUTER, *names], "egress", _EVERYTHING, [keys.everything])
    access.grant("routers", [ROUTER], "ingress", _EVERYTHING, [keys.everything])
    access.grant("gateways hear", [GATEWAY], "ingress", ["declare_subscriber"], [keys.all_states, keys.all_progress])
    access.grant("gateways ask", [GATEWAY], "ingress", ["query"], [keys.of_all_robots(kind) for kind in _ASKED])
    access.grant("gateways see", [GATEWAY], "ingress", _WATCHING, [keys.all_presence])
    access.grant("gateways are", [GATEWAY], "ingress", ["liveliness_token"], [keys.all_gateways])
    access.grant("gateways beat", [GATEWAY], "ingress", ["put"], [keys.all_heartbeats])
    access.grant("agents see", names, "ingress", _WATCHING, [keys.all_gateways])
    access.grant("agents hear", names, "ingress", ["declare_subscriber"], [keys.all_heartbeats])
    for agent, robots in agents.items():
        own = [keys.everything_of(robot) for robot in robots] if robots is not None else [keys.everything_of_robots]
        name = common_name(agent)
        access.grant(f"agent {name}", [name], "ingress", (*_PUBLISHING, "liveliness_query"), own)
    return access.value


def of_agent(keys: Keys) -> dict[str, object]:
    """Return ``access_control`` of a listening agent: gateways and routers may speak to it, no other robot may."""
    access = _Access()
    for flow in ("egress", "ingress"):
        access.grant(f"fleet {flow}", [GATEWAY, ROUTER], flow, _EVERYTHING, [keys.everything])
    return access.value


class _Access:
    """Collects grants; everything else is denied."""

    def __init__(self) -> None:
        self._rules: list[object] = []
        self._subjects: list[object] = []
        self._policies: list[object] = []

    def grant(self, grant: str, to: Sequence[str], flow: str, messages: Sequence[str], keys: Sequence[str]) -> None:
        if to:  # a subject without a name would match everybody
            rule = {"permission": "allow", "flows": [flow], "messages": list(messages), "key_exprs": list(keys)}
            self._rules.append({"id": grant, **rule})
            self._subjects.append({"id": grant, "cert_common_names": list(to)})
            self._policies.append({"rules": [grant], "subjects": [grant]})

    @property
    def value(self) -> dict[str, object]:
        lists = {"rules": self._rules, "subjects": self._subjects, "policies": self._policies}
        return {"enabled": True, "default_permission": "deny", **lists}
