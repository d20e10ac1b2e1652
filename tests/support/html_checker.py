"""The Nu Html Checker of the W3C on documents, all in one run of Java."""

import json
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path

_THINGS = Path(__file__).parents[2] / "gateway/linked_fleet_gateway/extensions/things"
JAR = _THINGS / "tests/node_modules/vnu-jar/build/dist/vnu.jar"


def errors(documents: Mapping[str, bytes], folder: Path) -> list[str]:
    """Return the errors with their document; ``folder`` is for files. Raises FileNotFoundError without Java."""
    java = shutil.which("java")
    if java is None or not JAR.exists():
        raise FileNotFoundError("the Nu Html Checker needs Java and vnu-jar: apt install default-jre-headless")
    names = {}
    for number, (name, content) in enumerate(documents.items()):
        file = folder / f"{number}.html"
        file.write_bytes(content)
        names[file.as_uri()] = name
    command = [java, "-Xmx512m", "-jar", str(JAR), "--errors-only", "--format", "json", "--exit-zero-always"]
    ran = subprocess.run([*command, *(str(folder / f"{n}.html") for n in range(len(documents)))],
                         capture_output=True, text=True, check=True)  # fmt: skip
    found = json.loads(ran.stderr)["messages"]
    return [f"{names.get(each.get('url', ''), '?')}: {each['message']} ({each.get('extract', '')!r})" for each in found]
