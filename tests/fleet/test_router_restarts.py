"""Three routers that are restarted one by one, as when a robot joins: nobody holds."""

import contextlib
import json
import os
import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from browser import LF, Browser
from certificates import made
from commanding import PAN, begun, moving, of_joint, put, slowly
from fake_robots import real_session
from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.wire.trust import mutual_tls
from running import ROOT, Process, eventually, free_port, process
from small_fleet import live

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
ROBOTS = ("a", "b", "c")
WIRE = "/etc/linked-fleet/wire"
ROUTERS = ("router-1", "router-2", "router-3")
# Stand-ins for commands of the page. A machine is a folder, in which a command runs with its paths below it.
SSH = f"""#!/bin/sh
machine=${{1#root@}}; shift; cd "$SITE/$machine"
exec sh -c "$(printf %s "$*" | sed "s#{WIRE}#$PWD{WIRE}#g")"
"""
SCP = """#!/bin/sh
exec cp "$1" "$SITE/$(printf %s "${2#root@}" | sed 's#:##')"
"""
SYSTEMCTL = """#!/bin/sh
echo "$*" > order; while [ -e order ]; do /bin/sleep 0.05; done
"""
SLEEP = "#!/bin/sh\n"


def commands() -> str:
    """Return the commands by which a robot joins, as deploy/README.md has them."""
    page = (ROOT / "deploy" / "README.md").read_text()
    (found,) = re.findall(r"```sh\n(python3 deploy/certificates certificates --agent rover\n.*?)```", page, re.S)
    return str(found)


class Site:
    """Machines as folders of ``folder``, with routers at loopback endpoints."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.wire = folder, folder / "certificates"
        self.endpoints = {name: f"tls/127.0.0.1:{free_port()}" for name in ROUTERS}
        self.agents = list[Process]()
        self._routers = dict[str, contextlib.ExitStack]()
        for name in (*ROUTERS, "rover"):
            (folder / f"{name}{WIRE}").mkdir(parents=True)
        for name, text in (("ssh", SSH), ("scp", SCP), ("systemctl", SYSTEMCTL), ("sleep", SLEEP)):
            path = folder / "bin" / name
            path.parent.mkdir(exist_ok=True)
            path.write_text(text)
            path.chmod(0o755)

    def start(self, name: str) -> None:
        """Start a router with the file on its machine."""
        config = json.loads((self.folder / f"{name}{WIRE}/router.json5").read_text().replace(WIRE, str(self.wire)))
        config["listen"]["endpoints"] = [self.endpoints[name]]
        path = self.folder / name / "local.json5"
        path.write_text(json.dumps(config))
        others = [endpoint for other, endpoint in self.endpoints.items() if other != name]
        self._routers[name] = contextlib.ExitStack()
        router = self._routers[name].enter_context(process("tests/support/zenoh_router.py", str(path), *others))
        router.said("routing")

    def restart(self, name: str) -> None:
        """Restart a router. It is away until its robots are at another one."""
        before = self._returns()
        self._routers[name].close()
        eventually(lambda: self._returns() > before, f"robots of {name} at another router")
        self.start(name)

    def _returns(self) -> int:
        return sum(agent.output.count("is back") for agent in self.agents)

    def close(self) -> None:
        for each in self._routers.values():
            each.close()

    def has_gateway(self, name: str) -> bool:
        """Return True if a router knows the gateway, as agents that come to it need within their grace.

        Of robots at other routers it may know nothing until they renew their declarations (Zenoh 1.10); gateways hear
        of these from the other routers.
        """
        files = (str(self.wire / each) for each in ("ca.pem", "router.pem", "router.key"))
        settings = {"connect/endpoints": [self.endpoints[name]], "transport/link/tls": mutual_tls(*files)}
        with real_session({"mode": "client", **settings}) as session:
            replies = session.liveliness().get(Keys().all_gateways, timeout=2.0)
            return any(reply.ok for reply in replies)

    def agent(self, name: str, first: int) -> contextlib.AbstractContextManager[Process]:
        """Run an agent that knows all routers and connects to the ``first`` one."""
        order = [*self.endpoints.values()][first:] + [*self.endpoints.values()][:first]
        command = ("-m", "linked_fleet_agent", f"--robot={name}=ur5", "--connect", ",".join(order))
        return process(*command, *self._proof(f"agents/{name}", "--"))

    def gateway(self, port: int) -> contextlib.AbstractContextManager[Process]:
        command = ("-m", "linked_fleet_gateway", "--port", str(port), "--state-dir", str(self.folder / "state"))
        routers = ("--zenoh-connect", ",".join(self.endpoints.values()))
        return process(*command, *routers, *self._proof("gateway", "--zenoh-"))

    def _proof(self, who: str, prefix: str) -> tuple[str, ...]:
        files = {"ca": "ca.pem", "cert": f"{who}.pem", "key": f"{who}.key"}
        return tuple(word for flag, name in files.items() for word in (f"{prefix}{flag}", str(self.wire / name)))


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    with contextlib.closing(Site(tmp_path)) as site:
        made(site.wire, "--agent", ",".join(ROBOTS), "--router", "127.0.0.1", "--installed", WIRE)
        for name in ROUTERS:
            shutil.copy(site.wire / "router.json5", site.folder / f"{name}{WIRE}")
            site.start(name)
        yield site


def carry_out(site: Site, commands: str, enable: Callable[[], object]) -> list[tuple[str, str]]:
    """Run commands. Carry out what they say to systemd, and return it: a machine and the words."""
    (site.folder / "deploy").symlink_to(ROOT / "deploy")
    path = f"{site.folder / 'bin'}:{Path(sys.executable).parent}:{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "SITE": str(site.folder)}
    said, done = list[tuple[str, str]](), list["subprocess.CompletedProcess[str]"]()

    def run() -> None:
        command = ("bash", "-e", "-c", commands)
        done.append(subprocess.run(command, cwd=site.folder, env=environment, capture_output=True, text=True))

    def carried_out() -> bool:
        for order in site.folder.glob("*/order"):
            if words := order.read_text().strip():
                said.append((order.parent.name, words))
                if words == "enable --now linked-fleet-agent":
                    enable()
                elif words == "restart zenohd":
                    site.restart(order.parent.name)
                    eventually(lambda order=order: site.has_gateway(order.parent.name), "the gateway there")
                order.unlink()
        return bool(done)

    thread = threading.Thread(target=run)
    thread.start()
    eventually(carried_out, "the end of the commands")
    thread.join()
    assert done[0].returncode == 0, done[0].stderr
    return said


def test_a_robot_joins_by_three_commands_while_the_others_move(site: Site) -> None:
    """Agents and gateways know all routers. Each router restarts once, when the one before has the gateway again."""
    assert len(re.findall(r"^(?!done)\S", commands(), re.M)) == 3
    port = free_port()
    with contextlib.ExitStack() as stack:
        site.agents = [stack.enter_context(site.agent(name, index)) for index, name in enumerate(ROBOTS)]
        gateway = stack.enter_context(site.gateway(port))
        gateway.said("serving")
        browser = stack.enter_context(contextlib.closing(Browser(f"http://127.0.0.1:{port}/")))
        for name in ROBOTS:
            live(browser, name)
        motions = [begun(put(browser, of_joint(browser, PAN, robot=name), slowly(3.0, speed=0.02))) for name in ROBOTS]
        for name in ROBOTS:
            moving(browser, PAN, name, by=0.01)
        rover = site.agent("rover", 0)
        said = carry_out(site, commands(), lambda: stack.enter_context(rover))
        assert said == [("rover", "enable --now linked-fleet-agent"), *((name, "restart zenohd") for name in ROUTERS)]
        for name, motion in zip(ROBOTS, motions, strict=True):
            live(browser, name)
            assert browser.page(motion).one(LF.state) == LF.running
            moving(browser, PAN, name, by=0.01)
        assert not [agent.output for agent in site.agents if "the last gateway is gone" in agent.output]
        for name in ("own.pem", "own.key"):
            installed, original = (
                site.folder / f"rover{WIRE}" / name,
                site.wire / "agents" / name.replace("own", "rover"),
            )
            assert installed.read_bytes() == original.read_bytes()
        live(browser, "rover")
