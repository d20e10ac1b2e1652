"""Messages may be decoded in several threads of a process that has decoded none before."""

import subprocess
import sys

import pytest

_READERS = """
import sys, threading
from linked_fleet_agent.wire.codec import decode
from linked_fleet_agent.wire.components import read_declarations
from linked_fleet_agent.wire.messages import PictureQuery, WIRE_VERSION
sys.setswitchinterval(1e-6)
together, read = threading.Barrier(16), []
picture = b'{{"version": %d, "camera": "eye", "format": "jpeg"}}' % WIRE_VERSION
lamp = b'[{{"name": "lamp", "properties": {{"on": {{"schema": {{"type": "boolean"}}}}}}}}]'
def work():
    together.wait()
    {work}
    read.append(1)
threads = [threading.Thread(target=work) for _ in range(16)]
for each in threads: each.start()
for each in threads: each.join()
print(len(read))
"""


@pytest.mark.parametrize("work", ["read_declarations(lamp, (), ())", "decode(picture, PictureQuery)"])
def test_the_first_messages_are_decoded_by_many_threads(work: str) -> None:
    """Threads that resolved the types of a structure at the same time ended the process by a memory fault."""
    program = _READERS.format(work=work)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.strip()) == (0, "16"), done.stderr
