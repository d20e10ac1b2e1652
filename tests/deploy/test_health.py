"""Health checks of containers."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

# /proc/net/tcp of an agent: one listening socket, one connection to port 7447 (1D17)
_HEAD = "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode\n"
_LISTENING = "   0: 0100007F:1D17 00000000:0000 0A 00000000:00000000 00:00000000 00000000     0        0 1 1 0\n"
_LINKED = "   1: 0200000A:C350 0300000A:1D17 01 00000000:00000000 00:00000000 00000000     0        0 2 1 0\n"
_CLOSING = _LINKED.replace(" 01 ", " 08 ")


@pytest.fixture
def agent_health() -> ModuleType:
    path = Path(__file__).parents[2] / "deploy" / "agent_health.py"
    spec = importlib.util.spec_from_file_location("agent_health", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_ports_of_endpoints(agent_health: ModuleType) -> None:
    assert agent_health.parse_ports("tcp/router:7447,tcp/[::1]:7448, tls/far.example:7449#iface=eth0") == {
        7447,
        7448,
        7449,
    }


@pytest.mark.parametrize(("rows", "healthy"), [(_LISTENING, False), (_LINKED, True), (_CLOSING, False), ("", False)])
def test_an_agent_is_healthy_while_a_router_is_connected(agent_health: ModuleType, rows: str, healthy: bool) -> None:
    assert agent_health.is_connected(_HEAD + rows, {7447}) is healthy


def test_a_connection_to_somewhere_else_is_none(agent_health: ModuleType) -> None:
    assert not agent_health.is_connected(_HEAD + _LINKED, {7448})
