"""Events of the fleet and latest frames, handed over from the threads of the transport to the event loop.

The latest frame of each robot is stored by the transport's thread and read by the event loop on demand. On arrival of a
frame that continues a run only the fields that could invalidate it are checked. So a robot that nobody watches costs
almost nothing, and malformed, late or foreign frames never replace a good one.
"""

import struct
import threading
from collections import deque
from collections.abc import Callable, Container, Iterator
from dataclasses import dataclass, field

from linked_fleet_agent.wire import messages
from linked_fleet_agent.wire.codec import layout


@dataclass(frozen=True)
class Appeared:
    """The presence token of one run of an agent has appeared."""

    robot: str
    incarnation: int


@dataclass(frozen=True)
class Vanished:
    """The presence token of one run of an agent has gone."""

    robot: str
    incarnation: int


@dataclass(frozen=True)
class Described:
    """An agent has sent the description of its robot."""

    description: messages.Description


@dataclass(frozen=True)
class DescriptionRejected:
    """An agent is present, but its description is unusable."""

    robot: str
    incarnation: int
    reason: str


@dataclass(frozen=True)
class Framed:
    """A state frame has arrived; it is not yet decoded."""

    robot: str
    payload: bytes


@dataclass(frozen=True)
class Conditioned:
    """An agent has sent the condition of its robot."""

    robot: str
    condition: messages.Condition


Event = Appeared | Vanished | Described | DescriptionRejected | Framed | Conditioned


MAX_KEYS = 20_000
MAX_TOKENS_OF_ONE = 64
"""Several times the number of runs that a robot has at once."""
MAX_QUEUED_OF_ONE = 512
"""Twice what a correct agent repeats at once to a new gateway."""
MAX_QUEUED = 10_000
MAX_QUEUED_BYTES = 32 * 1024 * 1024

Payload = bytes | int  # of a payload that is too large only its size is kept


class MessageQueue:
    """Messages in the order of their arrival: at most ``MAX_QUEUED_OF_ONE`` of a key, of which later ones are dropped,
    and ``MAX_QUEUED`` or ``MAX_QUEUED_BYTES`` in all, of which the oldest are.
    """

    def __init__(self) -> None:
        self._messages = deque[tuple[str, Payload]]()
        self._counts: dict[str, int] = {}
        self._bytes = 0

    def put(self, key: str, payload: Payload) -> None:
        count = self._counts.get(key, 0)
        if count >= MAX_QUEUED_OF_ONE:
            return
        self._counts[key] = count + 1
        self._messages.append((key, payload))
        self._bytes += _size(payload)
        while len(self._messages) > MAX_QUEUED or self._bytes > MAX_QUEUED_BYTES:
            self._bytes -= _size(self._messages.popleft()[1])

    def __iter__(self) -> Iterator[tuple[str, Payload]]:
        return iter(self._messages)

    def __len__(self) -> int:
        return len(self._messages)


def _size(payload: Payload) -> int:
    return len(payload) if isinstance(payload, bytes) else 0


@dataclass
class Batch:
    """Messages since the last batch.

    ``presence`` by key (True: present), ``states``: by key the latest condition, and the latest frame that needs a full
    check, ``progress`` and messages about components in order. ``tokens`` are the entries of ``presence`` by robot.
    ``presence_lost`` says that some presence did not fit.
    """

    presence: dict[str, bool] = field(default_factory=dict)
    states: dict[str, Payload] = field(default_factory=dict)
    progress: MessageQueue = field(default_factory=MessageQueue)
    of_components: MessageQueue = field(default_factory=MessageQueue)
    tokens: dict[str, int] = field(default_factory=dict)
    presence_lost: bool = False


class Wake:
    """Calls a function from any thread to wake a reader, once until the reader has looked."""

    def __init__(self, call: Callable[[], object] | None = None) -> None:
        """``call`` may be given later, by ``open``."""
        self._lock = threading.Lock()
        self._call = call
        self.pending = False
        """True if the reader was woken and has not looked yet; it sets this to False before it looks."""

    def open(self, call: Callable[[], object]) -> None:
        self._call = call

    def close(self) -> None:
        """Wake nobody any more. No call is in progress when this returns."""
        with self._lock:
            self._call, self.pending = None, False

    def wake(self) -> None:
        with self._lock:
            if not self.pending and self._call is not None:
                self.pending = True
                self._call()


class Inbox:
    """Filled by any thread and emptied by one reader, who is woken once per batch.

    Overflow policy: one presence and one state per key, the latest wins. New keys beyond ``MAX_KEYS`` are refused, and
    so is presence of one robot beyond ``MAX_TOKENS_OF_ONE``; the reader is then told to list all tokens. Progress,
    and messages about components, wait in a ``MessageQueue`` each. So no robot can suppress others, and a batch is read
    in bounded time.
    """

    def __init__(self, wake: Callable[[], object]) -> None:
        self._lock = threading.Lock()
        self._reader = Wake(wake)
        self._batch = Batch()

    def put_presence(self, key: str, present: bool) -> None:
        with self._lock:
            batch, robot = self._batch, key.rpartition("/")[0]
            # removed first, so that the order is that of the latest change
            known, tokens = batch.presence.pop(key, None) is not None, batch.tokens.get(robot, 0)
            if known or (len(batch.presence) < MAX_KEYS and tokens < MAX_TOKENS_OF_ONE):
                batch.presence[key] = present
                batch.tokens[robot] = tokens + (not known)
            else:
                batch.presence_lost = True
            self._reader.wake()

    def put_state(self, key: str, payload: Payload) -> None:
        with self._lock:
            if len(self._batch.states) < MAX_KEYS or key in self._batch.states:
                self._batch.states[key] = payload
            self._reader.wake()

    def put_progress(self, key: str, payload: Payload) -> None:
        with self._lock:
            self._batch.progress.put(key, payload)
            self._reader.wake()

    def put_of_components(self, key: str, payload: Payload) -> None:
        with self._lock:
            self._batch.of_components.put(key, payload)
            self._reader.wake()

    def take(self) -> Batch | None:
        """Return the messages since the last call; None if there are none."""
        if not self._reader.pending:
            return None
        with self._lock:
            self._reader.pending = False
            batch, self._batch = self._batch, Batch()
            return batch

    def close(self) -> None:
        """Stop waking the reader, and drop what it has not taken."""
        self._reader.close()
        with self._lock:
            self._batch = Batch()


_OFFSET = {field.name: field.offset for field in layout(1, False)}
_TIMES = struct.Struct("<Qqq")  # sequence, monotonic and wall time
_BEGIN = _OFFSET["sequence"]
"""Length of the prefix that all frames of one run and shape share: magic, version, flags, joints, incarnation."""

Received = tuple[bytes, int, int, int]
"""A frame: payload, gateway wall time of arrival (ns), sequence number, agent's wall time (ns)."""


class Latest:
    """The latest frame of one run with one shape. One thread replaces ``frame``, another reads it."""

    __slots__ = ("begin", "count", "frame", "robot", "scheduled", "size", "unreported")

    def __init__(self, robot: str, frame: Received, count: int = 1) -> None:
        self.robot = robot
        self.frame = frame
        self.count = count
        """Number of frames of the run that have arrived."""
        self.begin, self.size = frame[0][:_BEGIN], len(frame[0])
        """Begin and length that all frames of the run have."""
        self.unreported = False
        """True if the watchers of the robot have not been told of the frame."""
        self.scheduled = False
        """True if the event loop is already scheduled to read it."""


class Frames:
    """The latest frame of each robot. ``key_of`` maps a robot's name to the key of its frames.

    ``taken`` counts stored frames. ``reader`` is woken for frames of robots in ``watched``, or of all robots while
    ``has_listeners``. It gets their names from ``next_moved``, each once before ``Robot.tell``.
    """

    def __init__(self, key_of: Callable[[str], str] = str) -> None:
        self.taken = 0
        self.watched: Container[str | None] = frozenset()
        self.has_listeners = False
        self.reader = Wake()
        self._moved: deque[str] = deque()
        self._key_of = key_of
        self._latest: dict[str, Latest] = {}

    def open(self, latest: Latest) -> None:
        """Store frames that continue this run from now on."""
        self._latest[self._key_of(latest.robot)] = latest

    def close(self, robot: str) -> None:
        self._latest.pop(self._key_of(robot), None)

    def latest_frames(self) -> list[Latest]:
        """Return the latest frames of all robots. Only the event loop, which opens and closes them, may call this."""
        return list(self._latest.values())

    def is_open(self, latest: Latest) -> bool:
        """Return True if frames continue this run, whose robot has the same description since."""
        return self._latest.get(self._key_of(latest.robot)) is latest

    def put(self, key: str, payload: bytes, now_ns: int) -> bool:
        """Store a frame that continues its run. Return False for any other, which needs a full check.

        Called by one thread at a time.
        """
        latest = self._latest.get(key)
        if latest is None or len(payload) != latest.size or not payload.startswith(latest.begin):
            return False
        sequence, monotonic_ns, wall_ns = _TIMES.unpack_from(payload, _BEGIN)
        if sequence <= latest.frame[2] or monotonic_ns < 0 or wall_ns < 0:
            return False
        latest.frame = (payload, now_ns, sequence, wall_ns)
        latest.count += 1
        latest.unreported = True
        self.taken += 1
        if not latest.scheduled and (self.has_listeners or latest.robot in self.watched):
            self._schedule(latest)
        return True

    def schedule_missed(self) -> None:
        """Schedule the robots whose latest frame came before somebody watched them."""
        for latest in self._latest.values():
            if latest.unreported and not latest.scheduled and (self.has_listeners or latest.robot in self.watched):
                self._schedule(latest)

    def _schedule(self, latest: Latest) -> None:
        latest.scheduled = True
        self._moved.append(latest.robot)
        self.reader.wake()

    def next_moved(self) -> str | None:
        """Return the next watched robot with a newer frame; None if there is none, and the reader is woken for more."""
        if not self._moved:
            self.reader.pending = False
        # Looks again, for a frame that came just before.
        return self._moved.popleft() if self._moved else None
