"""Runs the commands of a page against the demo that answers at port 8000, as a reader of the page would: PAGE.

Prints a line for each command. Exit code 1 if one fails or prints something else than the page shows. The command that
starts the demo has been run by whoever runs this.
"""

import sys
import tempfile
import time
from pathlib import Path

from transcript import File, Shell, matches, ports_of, steps


def main(page: Path) -> int:
    text, wrong = page.read_text(), 0
    with tempfile.TemporaryDirectory() as folder:
        shell = Shell(Path(folder), {port: port for port in ports_of(text) | {"8000"}})
        try:
            for step in steps(text):
                if isinstance(step, File):
                    shell.write(step)
                elif not step.text.startswith("make demo"):
                    begin = time.monotonic()
                    said, status = shell.run(step)
                    held = status == 0 if step.output is None else matches(step.output, said)
                    wrong += not held
                    first = step.text.splitlines()[0]
                    print(f"{'held' if held else 'not '} {time.monotonic() - begin:5.1f} s  line {step.line}: {first}")
                    if not held:
                        print(f"exit status {status}\n-- the page\n{step.output}\n-- the command\n{said}")
        finally:
            shell.close()
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
