"""Endpoints that accept anybody, and messages about invalid credential files."""

from pathlib import Path

import pytest

from certificates import made
from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.wire.trust import (
    Credentials,
    agent_access_control,
    common_name,
    router_access_control,
    unauthenticated_endpoints,
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("certificates"), "--agent", "a")


def test_endpoints_that_other_machines_reach_without_proof(folder: Path) -> None:
    proof = Credentials(*(str(folder / name) for name in ("ca.pem", "gateway.pem", "gateway.key")))
    local = ("tcp/127.0.0.1:7447", "udp/localhost:1", "tls/[::1]:7447#so_rcvbuf=1", "unixsock-stream//tmp/x")
    reached = ("tcp/[::]:7447", "tcp/192.0.2.1:7447", "udp/robot:7447", "ws/0.0.0.0:1", "serial/ttyUSB0", "nonsense")
    proven = ("tls/0.0.0.0:7447", "quic/[::]:7447?prio=1#iface=eth0")
    assert unauthenticated_endpoints((*local, *reached, *proven), proof) == reached
    assert unauthenticated_endpoints((*local, *reached, *proven), None) == (*reached, *proven)


def test_files_that_are_no_credentials(folder: Path) -> None:
    """One line each, which names the file."""
    ca, certificate, key = (str(folder / name) for name in ("ca.pem", "gateway.pem", "gateway.key"))
    assert Credentials.from_optional_files("", "", "") is None
    for given, said in (
        ((ca, "", key), "set together"),
        (
            (ca, certificate, str(folder / "router.key")),
            "gateway.pem and .*router.key are not a certificate and its key",
        ),
        ((ca, str(folder / "missing"), key), "missing cannot be read: No such file"),
        ((key, certificate, key), "gateway.key is not the certificate of an authority"),
    ):
        with pytest.raises(ValueError, match=said) as caught:
            Credentials.from_optional_files(*given)
        assert "\n" not in str(caught.value)


def test_agents_cannot_have_names_of_gateways() -> None:
    for name in ("gateway", "router"):
        with pytest.raises(ValueError, match="is reserved"):
            router_access_control(Keys(), {name: [name]})
    assert common_name("hall 2") == "hall~202"


def test_every_subject_has_a_name() -> None:
    """Zenoh applies a subject without a name to everybody."""
    for access in (
        router_access_control(Keys(), {}),
        router_access_control(Keys(), {"a": ["a"], "sim": None}),
        agent_access_control(Keys()),
    ):
        assert access["default_permission"] == "deny"
        subjects = access["subjects"]
        assert isinstance(subjects, list)
        assert subjects
        assert all(subject["cert_common_names"] for subject in subjects)
