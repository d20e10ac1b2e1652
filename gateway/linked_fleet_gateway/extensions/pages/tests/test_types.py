"""The types declared in the comments of the scripts, checked by the TypeScript compiler."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from needs import missing

FACE = Path(__file__).parents[1] / "scripts"
LONGEST_S = 180


def test_the_scripts_of_the_pages_keep_their_types() -> None:
    """Node.js is that of the machine, or the one that `scripts/build` has installed beside Python."""
    folders = (str(Path(sys.executable).parent), os.environ.get("PATH", ""))
    node = shutil.which("node", path=os.pathsep.join(folders))
    compiler = FACE / "node_modules" / "typescript" / "lib" / "tsc.js"
    if node is None or not compiler.is_file():
        missing("Node.js with TypeScript", "make assets")
    checked = subprocess.run(
        [node, str(compiler), "--project", str(FACE)], capture_output=True, text=True, timeout=LONGEST_S, check=False
    )
    assert checked.returncode == 0, checked.stdout[:4000]
