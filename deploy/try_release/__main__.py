"""Tries a release as a newcomer would, in an empty container of each image that is named: make try-release

Usage: PYTHON deploy/try_release [--engine COMMAND] [--options "WORDS"] [--dist FOLDER] [IMAGE...]

The container has the files of the release and the committed state of the checkout, and nothing else of this machine.
Prints the duration of each step. Exit code 1 if a step failed or an image is not available.
"""

import argparse
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
IMAGES = ("debian:12", "ubuntu:24.04")
_LONGEST_S = 3600
sys.path.insert(0, str(ROOT / "deploy"))

from release_images import engine_command  # noqa: E402 (it is beside this folder)


def container_command(engine: list[str], options: list[str], image: str, dist: Path, source: Path) -> list[str]:
    """Return the command that runs a newcomer's steps in a container, which is removed afterwards."""
    script = Path(__file__).with_name("newcomer.sh")
    mounts = {dist.resolve(): "/dist", source: "/source.tar", script: "/newcomer.sh"}
    volumes = [word for here, there in mounts.items() for word in ("-v", f"{here}:{there}:ro")]
    return [*engine, "run", "--rm", "--init", *options, *volumes, image, "bash", "/newcomer.sh"]


def main() -> int:
    parser = argparse.ArgumentParser(prog="deploy/try_release", description="Try a release as a newcomer would.")
    parser.add_argument(
        "--engine", default="", help="docker, podman or another command (default: the first that works)"
    )
    parser.add_argument("--options", default="", help="further words for its run command, such as --network host")
    parser.add_argument("--dist", type=Path, default=ROOT / "dist", help="files of the release (default: dist)")
    parser.add_argument("images", nargs="*", metavar="IMAGE", help=f"default: {' '.join(IMAGES)}")
    arguments = parser.parse_args()
    engine = engine_command(arguments.engine)
    if not engine:
        print("neither docker nor podman works here; name another: ENGINE=…", file=sys.stderr)
        return 1
    failed = 0
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder, "source.tar")
        subprocess.run(["git", "archive", "-o", source, "HEAD"], cwd=ROOT, check=True)  # noqa: S603, S607
        for image in arguments.images or IMAGES:
            print(f"{image}:", flush=True)
            words = container_command(engine, shlex.split(arguments.options), image, arguments.dist, source)
            failed += subprocess.run(words, timeout=_LONGEST_S, check=False).returncode != 0  # noqa: S603
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
