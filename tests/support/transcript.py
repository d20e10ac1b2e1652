"""Console transcripts of a Markdown page: parsed, run in one shell, and compared with the page.

A page may contain

- ``console`` blocks: lines that begin with ``$ `` are commands (``> `` continues one), the rest is their output;
- ``sh`` blocks: commands without output, each of which must succeed;
- any other block below a line that ends with a file name and a colon: the content of that file;
- ``<!-- not run: reason -->`` on the line before a block that cannot be run;
- ``<!-- another terminal -->`` there, for commands that continue while the next ones are run.

A command whose output ends with ``^C`` is interrupted as soon as it has printed what precedes that.

In output, ``…`` matches anything. Times, identifiers, versions and measured numbers are compared only by their form,
and line breaks are ignored.
"""

import os
import re
import select
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
_FENCE = re.compile(
    r"^(?P<before>[^\n]*)\n(?:\n)?```(?P<language>[a-z]*)[^\n]*\n(?P<body>.*?)^```$", re.MULTILINE | re.DOTALL
)
_FILE = re.compile(r"`([\w.-]+\.\w+)`[^`]*:$")
_NOT_RUN = re.compile(r"<!-- not run: .+ -->")
_INTERRUPT = "^C"
_OTHER_TERMINAL = "<!-- another terminal -->"
_PORT = re.compile(r"(?:127\.0\.0\.1|localhost)(?::|\", |\D+--port )(\d{4,5})\b|--port (\d{4,5})\b")
_MASKS = (
    (r"[0-9a-f]{8}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{12}", "<id>"),
    (r"\d{4}-\d\d-\d\dT\d\d(?::|%3A)\d\d(?::|%3A)\d\d(?:\.\d+)?Z?", "<time>"),
    (r"(?:Mon|Tue|Wed|Thu|Fri|Sat|Sun), \d\d \w{3} \d{4} \d\d:\d\d:\d\d GMT", "<date>"),
    (r"(?:\d{4}-\d\d-\d\d )?\d\d:\d\d:\d\d,\d{3}", "<clock>"),
    (r"\b\d{12,}-\d+\b", "<version>"),
    (r"\b[0-9a-f]{32,}\b", "<digest>"),
    (r"(?i)(content-length: )\d+", r"\1<length>"),
    (r"-?\b\d+\.\d+(?:[eE]-?\d+)?", "<number>"),
)
_PREFIXES = re.compile(r"^(?:data: )?@(?:prefix|base) .*\n", re.MULTILINE)
_TIMEOUT_S = 60.0


@dataclass(frozen=True)
class Command:
    """One command of a page. ``output``: None if the page shows none, and the exit status must be 0."""

    line: int
    text: str
    output: str | None


@dataclass(frozen=True)
class File:
    """A block of a page with the content of a file."""

    name: str
    text: str


def steps(page: str) -> Iterator[Command | File]:
    """Yield the commands and files of a page, in order."""
    for match in _FENCE.finditer(page):
        before, language, body = match["before"].strip(), match["language"], match["body"]
        line = page.count("\n", 0, match.start("body")) + 1
        if _NOT_RUN.fullmatch(before):
            continue
        if named := _FILE.search(before):
            yield File(named[1], body)
        elif before == _OTHER_TERMINAL:
            yield from (Command(line, f"{{ {text}}} > other-terminal 2>&1 &\n", None) for text in _commands(body))
        elif language == "console":
            yield from _transcript(body, line)
        elif language == "sh":
            yield from (Command(line, text, None) for text in _commands(body))
        elif body.startswith("$ "):
            raise AssertionError(f"line {line}: a block with commands is marked as console")


def _transcript(body: str, line: int) -> Iterator[Command]:
    command, output, first = "", "", line
    for number, text in enumerate(body.splitlines(keepends=True), line):
        if text.startswith("$ ") and not _is_open(command):
            if command:
                yield Command(first, command, output)
            command, output, first = text[2:], "", number
        elif _is_open(command):
            command += text.removeprefix("> ")
        else:
            output += text
    if command:
        yield Command(first, command, output)


def _commands(body: str) -> Iterator[str]:
    command = ""
    for text in body.splitlines(keepends=True):
        command += text
        if command.strip() and not _is_open(command):
            yield command
            command = ""
    assert not command.strip(), f"a command that does not end: {command}"


def _is_open(command: str) -> bool:
    """Return True if a shell would ask for another line."""
    if not command:
        return False
    checked = subprocess.run(["bash", "-n"], input=command, capture_output=True, text=True, check=False)
    return bool(checked.returncode or "here-document" in checked.stderr or command.endswith("\\\n"))


class Shell:
    """A shell in its own folder, which contains the entries of the checkout.

    ``ports`` maps the ports on pages to those that are used instead.
    """

    def __init__(self, folder: Path, ports: Mapping[str, str]) -> None:
        self._ports = dict(ports)
        self._folder = folder
        for entry in ROOT.iterdir():
            if not entry.name.startswith(".") or entry.name == ".venv":
                (folder / entry.name).symlink_to(entry)
        # The Node.js packages that a page tells its reader to install.
        (folder / "node_modules").symlink_to(ROOT / "gateway/linked_fleet_gateway/extensions/things/tests/node_modules")
        # On a terminal, curl shows no progress of what it prints.
        (folder / ".curlrc").write_text("silent\nshow-error\n")
        bin = Path(sys.executable).parent
        self._process = subprocess.Popen(
            [shutil.which("bash") or "bash", "--norc"],
            cwd=folder,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            env={
                **os.environ,
                "PATH": f"{bin}:{os.environ['PATH']}",
                "CURL_HOME": str(folder),
                "TERM": "dumb",
                "LINKED_FLEET_URL": f"http://127.0.0.1:{ports['8000']}/",
            },
        )
        self._write("set -m; trap : INT\n")

    def write(self, file: File) -> None:
        path = self._folder / file.name
        assert not path.is_symlink(), f"{file.name} is part of the checkout"
        path.write_text(self._there(file.text))

    def run(self, command: Command) -> tuple[str, int]:
        """Return output and exit status. A command whose output matches before it ends is interrupted, as by Ctrl-C."""
        end = f"<end of {command.line} {time.monotonic_ns()}>"
        self._write(f"{self._there(command.text)}\nprintf '%s %s\\n' '{end}' \"$?\"\n")
        said, deadline, interrupted = b"", time.monotonic() + _TIMEOUT_S, False
        while end.encode() not in said or not said.endswith(b"\n"):
            assert time.monotonic() < deadline, f"line {command.line} does not end:\n{command.text}\n{said.decode()}"
            ready, _, _ = select.select([self._process.stdout], [], [], 0.05)
            if ready:
                assert self._process.stdout is not None
                piece = os.read(self._process.stdout.fileno(), 65536)
                assert piece, f"the shell ended in line {command.line}:\n{said.decode()}"
                said += piece
            elif not interrupted and _is_whole(command.output, self._here(said.decode(errors="replace"))):
                self._interrupt()
                interrupted = True
        text, _, rest = said.decode(errors="replace").partition(end)
        return self._here(text), 0 if interrupted else int(rest.split()[0])

    def close(self) -> None:
        for group in self._children():
            _signal(group, signal.SIGTERM)
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            pipe.close()

    def _write(self, text: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(text.encode())
        self._process.stdin.flush()

    def _children(self) -> list[int]:
        """Return the shell's jobs, the latest last. With job control each leads a process group."""
        pid = self._process.pid
        return [int(each) for each in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]

    def _interrupt(self) -> None:
        if jobs := self._children():
            _signal(jobs[-1], signal.SIGINT)

    def _there(self, text: str) -> str:
        """Return the text with the ports of this run."""
        return _replaced(text, self._ports)

    def _here(self, text: str) -> str:
        """Return the text with the ports of the page."""
        return _replaced(text, {used: named for named, used in self._ports.items()})


def _signal(group: int, number: signal.Signals) -> None:
    try:
        os.killpg(group, number)
    except ProcessLookupError:  # it has just ended
        return


def _replaced(text: str, names: Mapping[str, str]) -> str:
    return re.sub(r"\d{4,5}", lambda found: names.get(found[0], found[0]), text)


def ports_of(page: str) -> set[str]:
    """Return the ports that a page names."""
    return {one or other for one, other in _PORT.findall(page)}


def matches(shown: str, said: str) -> bool:
    """Return True if the output shown on a page matches that of the command."""
    pieces = [_masked(piece) for piece in shown.rstrip().removesuffix(_INTERRUPT).split("…")]
    text = _masked(said)
    if len(pieces) == 1:
        return pieces[0] == text
    if not text.startswith(pieces[0]) or not text.endswith(pieces[-1]):
        return False
    at = len(pieces[0])
    for piece in pieces[1:-1]:
        found = text.find(piece, at)
        if found < 0:
            return False
        at = found + len(piece)
    return at + len(pieces[-1]) <= len(text)


def _is_whole(shown: str | None, said: str) -> bool:
    """Return True if a command to be interrupted has printed everything that the page shows before."""
    return shown is not None and shown.rstrip().endswith(_INTERRUPT) and matches(shown, said)


def _masked(text: str) -> str:
    text = _PREFIXES.sub("", text.replace("\r\n", "\n"))
    for pattern, name in _MASKS:
        text = re.sub(pattern, name, text)
    # Pages wrap long lines at spaces; a mask may stand at either side of one.
    return re.sub(r"\s+", "", text)
