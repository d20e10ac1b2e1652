"""The units for systemd: valid, hardened, and with keys that only the process gets."""

import contextlib
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from browser import Browser
from certificates import made
from running import Process, free_port, process
from small_fleet import live

DEPLOY = Path(__file__).parents[2] / "deploy"
AGENT, GATEWAY = "linked-fleet-agent.service", "linked-fleet-gateway.service"
WIRE, HTTPS = "linked-fleet-certificates.conf", "linked-fleet-https.conf"
_PYTHON = "/opt/linked-fleet/bin/python"


def lines(name: str) -> list[tuple[str, str]]:
    """Return the keys and values of a unit or drop-in, in order."""
    text = (DEPLOY / name).read_text().splitlines()
    return [(key, value) for key, sign, value in (line.partition("=") for line in text if line[:1] != "#") if sign]


def values(name: str, key: str) -> list[str]:
    return [value for each, value in lines(name) if each == key]


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not here")
@pytest.mark.parametrize(("unit", "drop_ins"), [(AGENT, [WIRE]), (GATEWAY, [WIRE, HTTPS])])
def test_systemd_accepts_the_units(tmp_path: Path, unit: str, drop_ins: list[str]) -> None:
    """Without a word, such as for an unknown key. The manual is left out, and Python is the one of the test."""
    (tmp_path / unit).write_text((DEPLOY / unit).read_text().replace(_PYTHON, sys.executable))
    (tmp_path / f"{unit}.d").mkdir()
    for name in drop_ins:
        shutil.copy(DEPLOY / name, tmp_path / f"{unit}.d")
    command = ("systemd-analyze", "verify", "--man=no", "--recursive-errors=no", str(tmp_path / unit))
    done = subprocess.run(
        command, env={**os.environ, "SYSTEMD_UNIT_PATH": f"{tmp_path}:"}, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.parametrize("unit", [AGENT, GATEWAY])
def test_a_process_that_fails_is_started_again_for_as_long_as_it_takes(unit: str) -> None:
    """A robot may be off for days. What no restart can mend is excluded by exit code."""
    assert values(unit, "StartLimitIntervalSec") == ["0"]
    assert (values(unit, "Restart"), values(unit, "RestartSec")) == (["always"], ["2"])
    assert values(unit, "RestartPreventExitStatus") == (["2"] if unit == AGENT else [])


def test_both_units_have_the_same_protection() -> None:
    def protection(unit: str) -> list[tuple[str, str]]:
        found = lines(unit)
        return found[found.index(("DynamicUser", "yes")) :]

    assert protection(AGENT) == protection(GATEWAY)


@pytest.mark.parametrize("drop_in", [WIRE, HTTPS])
def test_each_credential_is_used_and_each_used_one_is_loaded(drop_in: str) -> None:
    loaded = {value.partition(":")[0] for value in values(drop_in, "LoadCredential")}
    used = {value.partition("=")[2].removeprefix("%d/") for value in values(drop_in, "Environment")}
    assert loaded == used
    assert all(value.partition(":")[2].startswith("/etc/linked-fleet/") for value in values(drop_in, "LoadCredential"))


def environment(credentials: Path, state: Path, *names: str) -> dict[str, str]:
    """Return the variables of a unit and drop-ins, as systemd would set them."""
    pairs = (value.partition("=") for name in names for value in values(name, "Environment"))
    return {key: value.replace("%d", str(credentials)).replace("%S", str(state)) for key, _, value in pairs}


def credentials(folder: Path, sources: Path, who: str) -> Path:
    """Return a folder of credentials, made from the files that an operator has copied to /etc/linked-fleet/wire."""
    folder.mkdir()
    originals = {"ca.pem": "ca.pem", "own.pem": f"{who}.pem", "own.key": f"{who}.key"}
    for value in values(WIRE, "LoadCredential"):
        name, _, path = value.partition(":")
        shutil.copyfile(sources / originals[Path(path).name], folder / name)
        (folder / name).chmod(0o400)
    folder.chmod(0o500)
    return folder


@contextlib.contextmanager
def started(unit: str, variables: dict[str, str]) -> Iterator[Process]:
    """Run the command of a unit with these variables."""
    command, *arguments = values(unit, "ExecStart")[0].split()
    assert command == _PYTHON
    with contextlib.ExitStack() as kept:
        with pytest.MonkeyPatch.context() as patch:
            for name, value in variables.items():
                patch.setenv(name, value)
            running = kept.enter_context(process(*arguments))
        yield running


@pytest.mark.processes
def test_agent_and_gateway_read_their_keys_from_the_folder_of_credentials(tmp_path: Path) -> None:
    endpoint, port = f"tls/127.0.0.1:{free_port()}", free_port()
    wire = made(tmp_path / "wire", "--agent", "ur5", "--listen", endpoint)
    of_agent = environment(credentials(tmp_path / "agent", wire, "agents/ur5"), tmp_path, AGENT, WIRE)
    of_gateway = environment(credentials(tmp_path / "gateway", wire, "gateway"), tmp_path, GATEWAY, WIRE)
    both = {"LINKED_FLEET_ZENOH_CONNECT": endpoint}
    with (
        process("tests/support/zenoh_router.py", str(wire / "router.json5")) as router,
        started(AGENT, of_agent | both | {"LINKED_FLEET_ROBOT": "ur5"}),
        started(GATEWAY, of_gateway | both | {"LINKED_FLEET_PORT": str(port)}) as gateway,
        contextlib.closing(Browser(f"http://127.0.0.1:{port}/")) as browser,
    ):
        router.said("routing")
        gateway.said("serving")
        live(browser, "ur5")
        assert (tmp_path / "linked-fleet" / "appendonlydir").is_dir(), "the state is in the state directory"
