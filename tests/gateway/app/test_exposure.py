"""A gateway that other machines can reach requires TLS and identities, or an explicit flag that it has none."""

import ssl
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from signal import SIGHUP

import httpx
import pytest
from websockets.sync.client import connect

import linked_fleet_gateway.app.main as gateway
from certificates import made
from linked_fleet_agent.settings import SettingsError, read_settings
from linked_fleet_gateway.app.settings import exposure_problems
from running import free_port, process


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("pair"), "--router", "127.0.0.1")


Refusal = Callable[..., str]


@pytest.fixture
def refusal(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Refusal:
    """Start a gateway that ends before it listens, and return its single line of output."""

    def refused(*arguments: str) -> str:
        monkeypatch.setattr(sys, "argv", ["gateway", *arguments])
        assert gateway.main() == 1
        (line,) = capsys.readouterr().err.splitlines()
        return line

    monkeypatch.setattr(gateway, "_listen", lambda *_: pytest.fail("it is not refused"))
    return refused


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("--host", "0.0.0.0"), ("LINKED_FLEET_TLS_CERT", "LINKED_FLEET_IDENTITIES", "plain-http", "anonymous")),
        (("--host", "0.0.0.0", "--allow", "plain-http"), ("LINKED_FLEET_IDENTITIES", "=anonymous")),
        (("--host", "::", "--allow", "anonymous"), ("LINKED_FLEET_TLS_CERT", "=plain-http")),
        (("--zenoh-listen", "tcp/[::]:7447"), ("tcp/[::]:7447", "LINKED_FLEET_ZENOH_CA", "=plain-zenoh")),
        (("--allow", "everything"), ("plain-http, anonymous, plain-zenoh", "everything")),
        (("--tls-cert", "a.pem"), ("LINKED_FLEET_TLS_KEY", "together")),
        (("--tls-cert", "no.pem", "--tls-key", "no.key"), ("no.pem cannot be read",)),
        (("--zenoh-ca", "no.pem"), ("LINKED_FLEET_ZENOH_CERT", "together")),
        (("--zenoh-access", "no.json"), ("LINKED_FLEET_ZENOH_ACCESS", "no.json cannot be read")),
    ],
)
def test_refused_settings_are_reported_in_one_line(
    refusal: Refusal, arguments: tuple[str, ...], named: Sequence[str]
) -> None:
    line = refusal(*arguments)
    assert [text for text in named if text not in line] == []


def test_a_key_of_another_certificate_is_refused(refusal: Refusal, folder: Path) -> None:
    line = refusal("--tls-cert", str(folder / "router.pem"), "--tls-key", str(folder / "gateway.key"))
    assert "are not a certificate and its key" in line


def test_certificates_without_access_control_leave_a_listener_open(refusal: Refusal, folder: Path) -> None:
    """Every robot has a certificate; without rules each of them could command all others."""
    files = ("ca.pem", "gateway.pem", "gateway.key")
    given = [word for flag, name in zip(("ca", "cert", "key"), files, strict=True)
             for word in (f"--zenoh-{flag}", str(folder / name))]  # fmt: skip
    assert "ACCESS" in refusal("--zenoh-listen", "tls/[::]:7447", *given)


def test_waived_requirements_are_accepted() -> None:
    def found(*allowed: str, tls: bool = False, identities: bool = False) -> int:
        return len(
            exposure_problems(exposed=True, tls=tls, identities=identities, open_endpoints=["tcp/x:1"], allowed=allowed)
        )

    assert found() == 3
    assert found("plain-http", "anonymous", "plain-zenoh") == 0
    assert found("plain-zenoh", tls=True, identities=True) == 0
    assert found("anonymous", tls=True) == 1
    assert exposure_problems(exposed=False, tls=False, identities=False, open_endpoints=[], allowed=()) == []


def test_an_agent_that_anybody_reaches_is_refused() -> None:
    words = ["--robot", "ur5", "--listen", "tcp/0.0.0.0:7447"]
    with pytest.raises(SettingsError, match="plain-zenoh"):
        read_settings(words, {}, "host")
    assert read_settings([*words, "--allow", "plain-zenoh"], {}, "host").zenoh_listen == ("tcp/0.0.0.0:7447",)
    with pytest.raises(SettingsError, match="only plain-zenoh can be allowed"):
        read_settings([*words, "--allow", "plain-http"], {}, "host")


@pytest.mark.processes
def test_the_fleet_is_served_over_tls(folder: Path, tmp_path: Path) -> None:
    """All links of a page lead to https; a WebSocket opens; SIGHUP loads the present certificate."""
    pair = {flag: tmp_path / f"used.{flag}" for flag in ("cert", "key")}
    for flag, name in (("cert", "router.pem"), ("key", "router.key")):
        pair[flag].write_bytes((folder / name).read_bytes())
    port, zenoh = free_port(), f"tcp/127.0.0.1:{free_port()}"
    root, trusted = f"https://127.0.0.1:{port}/", ssl.create_default_context(cafile=folder / "ca.pem")
    words = ("--port", str(port), "--zenoh-listen", zenoh, "--state-dir", str(tmp_path / "state"))
    files = [word for flag, path in pair.items() for word in (f"--tls-{flag}", str(path))]
    with process("-m", "linked_fleet_gateway", *words, *files) as served:
        served.said(f"serving {root}")
        with httpx.Client(verify=trusted) as http:
            answer = http.get(root, headers={"accept": "text/turtle"})
            assert answer.status_code == 200
            assert f"@base <{root}>" in answer.text
            assert "http://127" not in answer.text + str(answer.headers)
        with connect(f"wss://127.0.0.1:{port}/", ssl=trusted) as websocket:
            assert "RoboticThing" in str(websocket.recv(timeout=20))
        foreign = made(tmp_path / "foreign", "--router", "127.0.0.1")
        for flag, name in (("cert", "router.pem"), ("key", "router.key")):
            pair[flag].write_bytes((foreign / name).read_bytes())
        served.send(SIGHUP)
        served.said("new connections get the certificate")
        with pytest.raises(httpx.ConnectError, match="CERTIFICATE_VERIFY_FAILED"):
            httpx.get(root, verify=trusted)
        assert httpx.get(root, verify=ssl.create_default_context(cafile=foreign / "ca.pem")).status_code == 200
