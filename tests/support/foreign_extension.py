"""An extension from outside of the repository, installed for the time of a test."""

import sys
import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def installed(folder: Path, name: str, code: str) -> Iterator[None]:
    """Install the class ``Added`` of ``code`` as the entry point ``name`` of a distribution in ``folder``."""
    module = f"{name}_extension"
    (folder / f"{module}.py").write_text(textwrap.dedent(code))
    metadata = folder / f"{name}-1.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\n")
    (metadata / "entry_points.txt").write_text(f"[linked_fleet.extensions]\n{name} = {module}:Added\n")
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        sys.path.remove(str(folder))
        sys.modules.pop(module, None)
