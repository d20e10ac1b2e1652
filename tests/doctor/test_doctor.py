"""The doctor finds each fault, and says in a sentence what to do."""

import asyncio
import os
import socket
import subprocess
import sys
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from certificates import made
from linked_fleet_doctor.__main__ import examine
from linked_fleet_doctor.finding import Finding, summary
from linked_fleet_doctor.libraries import check_libraries
from linked_fleet_doctor.machine import check_machine
from linked_fleet_doctor.redis_server import _clock
from redis_servers import single
from running import free_port, process

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
_ENDS = timedelta(days=90)


def _found(*arguments: str, **environment: str) -> list[Finding]:
    ports = ("--port", str(free_port())) if "--port" not in arguments else ()
    zenoh = ("--zenoh-listen", f"tcp/127.0.0.1:{free_port()}") if "--zenoh-connect" not in arguments else ()
    return asyncio.run(examine(environment, [*ports, *zenoh, *arguments]))


def _wrong(found: list[Finding]) -> list[str]:
    return [str(each) for each in found if each.is_fault]


def _certificate(folder: Path, first: datetime, last: datetime, host: str = "fleet.example") -> tuple[str, ...]:
    """Return flags with a self-signed certificate and its key."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, host)])
    builder = x509.CertificateBuilder(name, name, key.public_key(), x509.random_serial_number(), first, last)
    builder = builder.add_extension(x509.SubjectAlternativeName([x509.DNSName(host)]), critical=False)
    made_one = builder.sign(key, hashes.SHA256())
    (folder / "tls.pem").write_bytes(made_one.public_bytes(serialization.Encoding.PEM))
    form = (serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    (folder / "tls.key").write_bytes(key.private_bytes(*form))
    return ("--tls-cert", str(folder / "tls.pem"), "--tls-key", str(folder / "tls.key"))


def test_nothing_is_wrong_with_a_gateway_on_its_own(tmp_path: Path) -> None:
    found = _found("--state-dir", str(tmp_path / "state"))
    assert _wrong(found) == []
    assert summary(found) == "nothing is wrong"
    assert {each.subject for each in found} == {"port", "zenoh", "clocks", "libraries", "redis"}
    assert not (tmp_path / "state").exists(), "nothing is changed"


def test_a_setting_that_cannot_be_read_is_all_that_is_said() -> None:
    (said,) = _wrong(_found("--port", "many"))
    assert "LINKED_FLEET_PORT" in said


def test_a_gateway_that_would_be_refused_is_told_so() -> None:
    wrong = _wrong(_found("--host", "0.0.0.0", "--public-url", "https://fleet.example"))
    assert len(wrong) == 2
    assert "LINKED_FLEET_TLS_CERT" in wrong[0] and "LINKED_FLEET_IDENTITIES" in wrong[1]


def test_a_port_that_another_program_has_is_wrong() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = str(other.getsockname()[1])
        (said,) = _wrong(_found("--port", port, "--zenoh-connect", ""))
    assert f"127.0.0.1:{port} cannot be listened on: address already in use; choose another" in said


def test_a_gateway_that_serves_already_is_no_fault(tmp_path: Path) -> None:
    flags = ("--port", str(free_port()), "--zenoh-listen", f"tcp/127.0.0.1:{free_port()}", "--state-dir", str(tmp_path))
    with process("-m", "linked_fleet_gateway", *flags) as gateway:
        gateway.said("serving")
        found = _found(*flags)
    assert _wrong(found) == []
    assert any("a gateway serves" in each.sentence for each in found)


@pytest.mark.parametrize(
    ("first", "last", "wrong", "said"),
    [
        (-_ENDS, -timedelta(days=1), True, "expired on"),
        (timedelta(days=1), _ENDS, True, "later than now"),
        (-_ENDS, timedelta(days=3), False, "expires on"),
        (-_ENDS, _ENDS, False, "is valid until"),
    ],
)
def test_the_dates_of_a_certificate(tmp_path: Path, first: timedelta, last: timedelta, wrong: bool, said: str) -> None:
    now = datetime.now(UTC)
    found = _found(*_certificate(tmp_path, now + first, now + last), "--public-url", "https://fleet.example")
    assert bool(_wrong(found)) is wrong
    assert said in " ".join(each.sentence for each in found if each.subject == "tls")


def test_a_certificate_of_another_name_and_a_key_of_another_certificate_are_wrong(tmp_path: Path) -> None:
    now = datetime.now(UTC)
    flags = _certificate(tmp_path, now - _ENDS, now + _ENDS, "other.example")
    (said,) = _wrong(_found(*flags, "--public-url", "https://fleet.example"))
    assert "is not for fleet.example" in said
    (tmp_path / "tls.key").write_text("no key")
    (said,) = _wrong(_found(*flags, "--public-url", "https://other.example"))
    assert "are not a certificate and its key" in said


def test_redis_that_answers_and_redis_that_does_not(tmp_path: Path) -> None:
    with single(tmp_path) as server:
        found = _found("--redis-url", server.url)
        assert _wrong(found) == []
        assert any("that of Redis is" in each.sentence for each in found if each.subject == "clocks")
    url = f"redis://:secret@127.0.0.1:{free_port()}"
    (said,) = _wrong(_found("--redis-url", url))
    assert "does not serve" in said and "start it" in said
    assert "secret" not in said


def test_a_clock_that_is_wrong_is_found() -> None:
    now_s = time.time()
    ahead = _clock([int(now_s) + 90, 0], now_s, now_s)
    assert ahead.is_fault and "ahead of that of this machine" in ahead.sentence
    assert not _clock([int(now_s), int(now_s % 1 * 1e6)], now_s, now_s).is_fault


def test_a_library_that_the_system_lacks_is_named_with_its_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The dynamic loader finds an empty file instead of the library; Pinocchio is linked with it, Coal is not."""
    (tmp_path / "libgomp.so.1").touch()
    monkeypatch.setenv("LD_LIBRARY_PATH", str(tmp_path))
    (said,) = _wrong(_found())
    assert "pinocchio cannot be loaded" in said and "libgomp.so.1: file too short" in said
    assert "so reach and lf:canReach fail, and motions of placed robots are refused; apt install libgomp1" in said


def test_other_ways_in_which_a_library_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "crashes.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGILL)\n")
    message = "libodd.so.3: cannot open shared object file: No such file or directory"
    (tmp_path / "lacks_odd.py").write_text(f"raise ImportError({message!r})\n")
    (tmp_path / "broken.py").write_text("raise ImportError('undefined symbol')\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    crashes, lacks, broken, absent, fine = map(
        str, asyncio.run(check_libraries(["crashes", "lacks_odd", "broken", "not_there", "json"]))
    )
    assert "crashes ends its process by signal 4; install a version that fits" in crashes
    assert f"lacks_odd cannot be loaded: {message}; install the package of this system that has libodd.so.3" in lacks
    assert "broken cannot be loaded: undefined symbol; reinstall it" in broken
    assert "not_there is not installed: No module named 'not_there'; pip install linked-fleet" in absent
    assert "json can be loaded" in fine and "WRONG" not in fine


def test_routers_that_are_away_or_do_not_believe_us(tmp_path: Path) -> None:
    """The gateway's own certificate is accepted; one of another authority is not, which differs from silence."""
    (said,) = _wrong(_found("--zenoh-connect", f"tcp/127.0.0.1:{free_port()}"))
    assert "nothing answers at" in said and "start the router" in said
    endpoint = f"tls/127.0.0.1:{free_port()}"
    ours, theirs = (
        made(tmp_path / "ours", "--agent", "a", "--listen", endpoint),
        made(tmp_path / "theirs", "--agent", "a"),
    )
    with process("tests/support/zenoh_router.py", str(ours / "router.json5")) as router:
        router.said("routing")
        found = _found("--zenoh-connect", endpoint, *_wire(ours, "gateway"))
        assert _wrong(found) == []
        assert any("linked; 0 robots are present" in each.sentence for each in found)
        (said,) = _wrong(_found("--zenoh-connect", endpoint, *_wire(theirs, "gateway")))
        assert "the certificate of" in said and "is not believed" in said
        (said,) = _wrong(_found("--zenoh-connect", endpoint))
        assert "none is set" in said


def _wire(folder: Path, who: str) -> tuple[str, ...]:
    files = {"ca": "ca.pem", "cert": f"{who}.pem", "key": f"{who}.key"}
    return tuple(word for flag, name in files.items() for word in (f"--zenoh-{flag}", str(folder / name)))


def test_the_command_says_it_line_by_line_and_by_its_exit_code(tmp_path: Path) -> None:
    command = [sys.executable, "-P", "-m", "linked_fleet_doctor", "--zenoh-listen"]
    for url, code, last in (("", 0, "nothing is wrong"), ("ftp://x", 1, "1 thing is wrong")):
        flags = [f"tcp/127.0.0.1:{free_port()}", "--port", str(free_port()), "--state-dir", str(tmp_path)]
        environment = {**os.environ, "REDIS_URL": url}
        done = subprocess.run([*command, *flags], capture_output=True, text=True, env=environment)
        assert (done.returncode, done.stdout.splitlines()[-1]) == (code, last), done.stderr


def test_the_clock_of_a_machine_that_is_not_linux_is_a_note(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    found = check_machine()
    assert found.is_note and not found.is_fault
