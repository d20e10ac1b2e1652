"""The demo as a user starts it, in a session of its own."""

import contextlib
import os
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from browser import LF, Browser, Page, all_live
from running import PATIENCE_S, ROOT, eventually, free_port

ONLINE = b"<https://w3id.org/linked-fleet#presence> <https://w3id.org/linked-fleet#online>"


class Demo:
    """The demo in its own session, so that it can be signalled like in a terminal and its processes can be counted."""

    def __init__(self, folder: Path, *arguments: str, port: int | None = None) -> None:
        self.port = port or free_port()
        self._folder, self._log = folder, folder / f"output of {self.port}"
        with self._log.open("wb") as output:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "linked_fleet_demo", "--port", str(self.port), *arguments],
                cwd=ROOT,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                env={**os.environ, "TMPDIR": str(folder), "HOME": str(folder)},
            )

    @property
    def root(self) -> str:
        return f"http://127.0.0.1:{self.port}/"

    @property
    def output(self) -> str:
        return self._log.read_text(errors="replace")

    def robots_online(self) -> int:
        assert self.process.poll() is None, self.output
        request = urllib.request.Request(self.root, headers={"Accept": "application/n-triples"})
        try:
            with urllib.request.urlopen(request, timeout=2) as answer:
                return int(answer.read().count(ONLINE))
        except OSError:
            return 0

    def members(self) -> list[int]:
        """Return the living processes of the session, without zombies."""
        found = []
        for stat in Path("/proc").glob("[0-9]*/stat"):
            try:
                text = stat.read_text()
            except OSError:  # it has just ended
                continue
            state, _parent, _group, session = text.rpartition(")")[2].split()[:4]
            if int(session) == self.process.pid and state not in "ZX":
                found.append(int(stat.parent.name))
        return found

    def servers(self) -> list[int]:
        """Return the embedded servers: processes whose working directory is the data folder.

        They have their own sessions.
        """
        found = []
        for link in Path("/proc").glob("[0-9]*/cwd"):
            with contextlib.suppress(OSError):  # it has just ended
                if link.readlink().is_relative_to(self._folder):
                    found.append(int(link.parent.name))
        return found

    def agents(self) -> dict[str, int]:
        """Return the processes of agents by the robots that they serve, joined by commas."""
        found = {}
        for pid, words in self._commands().items():
            if "linked_fleet_agent" in words:
                found[",".join(words[at + 1] for at, word in enumerate(words) if word == "--robot")] = pid
        return found

    def gateway(self) -> int:
        """Return the process of the gateway."""
        return next(pid for pid, words in self._commands().items() if "linked_fleet_gateway" in words)

    def _commands(self) -> dict[int, list[str]]:
        """Return the words of the command of each living process."""
        return {pid: Path(f"/proc/{pid}/cmdline").read_text().split("\0") for pid in self.members()}

    def interrupt(self) -> int:
        """Press Ctrl-C: every process of the group gets the signal."""
        os.killpg(self.process.pid, signal.SIGINT)
        return self.process.wait(PATIENCE_S)

    def kill(self) -> None:
        """Kill what is left of it."""
        for pid in [*self.members(), *self.servers()]:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self.process.wait()


def _is_placed(browser: Browser, robot: Page) -> bool:
    """On a busy machine the demo says where the fleet is before all robots are placed."""
    placement = browser.page(str(robot.one(LF.placement)))
    return (None, None, LF.unknown) not in placement.graph


@contextlib.contextmanager
def running_demo(folder: Path, *arguments: str) -> Iterator[Demo]:
    """Run the demo, with six robots that send frames and are in their places."""
    demo = Demo(folder, *arguments)
    try:
        eventually(lambda: "The fleet is at" in demo.output, lambda: demo.output)
        with contextlib.closing(Browser(demo.root)) as browser:
            eventually(lambda: all_live(browser, 6), "six robots that send frames")
            eventually(lambda: all(map(partial(_is_placed, browser), browser.robots())), "robots in their places")
        yield demo
    finally:
        demo.kill()
