"""The examples of docs/EXTENDING.md, installed outside of the repository."""

import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PAGE = (Path(__file__).parents[2] / "docs" / "EXTENDING.md").read_text(encoding="utf-8")


def example_files(name: str) -> dict[str, str]:
    """Return the files of an example by name: the blocks below a line that names such a file."""
    found = re.findall(rf"`({name}\.\w+)`[^\n]*\n\n```\w+\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    return dict(found)


@contextmanager
def installed_example(name: str, folder: Path) -> Iterator[str]:
    """Put an example and its entry point into a folder of packages; yield the name to enable it by."""
    for file, content in example_files(name).items():
        (folder / file).write_text(content, encoding="utf-8")
    metadata = folder / f"{name}-1.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\n")
    (entry,) = re.findall(rf'^{name} = "(.*)"$', PAGE, re.MULTILINE)
    (metadata / "entry_points.txt").write_text(f"[linked_fleet.extensions]\n{name} = {entry}\n")
    sys.path.insert(0, str(folder))
    try:
        yield name
    finally:
        sys.path.remove(str(folder))
        sys.modules.pop(name, None)
