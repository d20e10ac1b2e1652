"""The check that a backup keeps everything: the fleet is saved, destroyed with its volumes and files, and restored."""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import kept_state
from checks import ROBOTS, Fleet, callback, more_callbacks, motion, online, ready, wait_for
from stack import StackError

from linked_fleet_identity.__main__ import new_token
from linked_fleet_identity.rights import EVERY, Right

_FILES = ("deploy/certificates/compose.yaml", "deploy/identities/compose.yaml")


def backup(fleet: Fleet) -> None:
    """saved, destroyed with all volumes and keys, and restored: nothing is lost"""
    with tempfile.TemporaryDirectory() as folder:
        site, saved = Path(folder, "site"), Path(folder, "saved")
        _secure(fleet, site)
        callback(fleet)
        motion(fleet)
        made = kept_state.make(fleet)
        wait_for(lambda: kept_state.rule_is_active(fleet, made), "the rule is active")
        before = kept_state.read(fleet, made)
        fleet.stack.backup("save", saved)
        _destroy(fleet, site)
        fleet.stack.backup("restore", saved)
        _start(fleet)
        wait_for(lambda: kept_state.rule_is_active(fleet, made), "the rule is active")
        assert not (changes := kept_state.differences(before, kept_state.read(fleet, made))), changes
        more_callbacks(fleet)
        motion(fleet)
        said = _certify(site, "rover")
        assert f"agents kept: {', '.join(ROBOTS)}" in said and "agents added: rover" in said, said


def _secure(fleet: Fleet, site: Path) -> None:
    """Start the fleet with certificates and identities, whose files are in ``site``."""
    _certify(site, ",".join(ROBOTS), "--router", "router", "--installed", "/etc/linked-fleet/wire")
    identities = site / "identities"
    identities.mkdir()
    fleet.front.token, table = new_token("operator", list(Right), [EVERY])
    (identities / "identities.toml").write_text(table)
    for path in site.rglob("*.key"):
        path.chmod(0o644)  # for users in the containers; the folder is this user's only
    fleet.stack.down(volumes=False)
    variables = {"LINKED_FLEET_CERTIFICATES": site / "certificates", "LINKED_FLEET_IDENTITIES_FOLDER": identities}
    fleet.stack.add(_FILES, {name: str(path) for name, path in variables.items()})
    _start(fleet)


def _certify(site: Path, agents: str, *options: str) -> str:
    """Return what deploy/certificates prints."""
    command = (sys.executable, "deploy/certificates", str(site / "certificates"), "--agent", agents, *options)
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
    if done.returncode:
        raise StackError(f"deploy/certificates: {done.stderr.strip()}")
    return done.stdout


def _start(fleet: Fleet) -> None:
    fleet.stack.up()
    wait_for(lambda: online(fleet) >= set(ROBOTS) and ready(fleet) == 2, "six robots online")


def _destroy(fleet: Fleet, site: Path) -> None:
    fleet.stack.down()
    shutil.rmtree(site)
    assert not (left := fleet.stack.volumes()), f"volumes are left: {left}"
