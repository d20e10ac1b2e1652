"""Builds the images of a release for each processor, as far as the engine here can: make release

Usage: PYTHON deploy/release_images.py [--engine COMMAND]

Prints a line for each image: built, with its id, or not built, with the reason. An image for a foreign processor needs
a kernel that runs its programs (QEMU and binfmt_misc). Exit code 1 if a build failed. A build that cannot be tried,
because an engine, a base image or such a kernel is missing, is no failure.
"""

import argparse
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
IMAGES = {"gateway": "gateway.Dockerfile", "agent": "agent.Dockerfile", "agent-sim": "agent.Dockerfile"}
"""Names of the images, which are also the build targets."""
PROCESSORS = {"amd64": "x86_64", "arm64": "aarch64"}
"""Architectures in image names, with their names in the kernel."""
BUILD_ARGUMENTS = ("PYTHON_TAG", "PIP_INDEX_URL", "PIP_EXTRA_INDEX_URL", "NPM_CONFIG_REGISTRY")
"""Build arguments that select the sources of base images and packages."""
_WITH_HEALTH_CHECKS = {"BUILDAH_FORMAT": "docker"}
"""Environment by which podman keeps the health checks of images, which its own format drops."""
_LONGEST_S = 3600
_BINFMT = Path("/proc/sys/fs/binfmt_misc")


def engine_command(command: str) -> list[str]:
    """Return the words of ``command``, else of docker or podman if it works; empty if neither does."""
    if command:
        return shlex.split(command)
    return next(([name] for name in ("docker", "podman") if shutil.which(name) and not _failure([name, "info"])), [])


def build_obstacle(engine: list[str], processor: str, binfmt: Path = _BINFMT) -> str:
    """Return why images for a processor cannot be built here; empty if they can."""
    if not engine:
        return "neither docker nor podman works here; name another: ENGINE=…"
    name = PROCESSORS[processor]
    if platform.machine() != name and not (binfmt / f"qemu-{name}").exists():
        return f"the kernel of this {platform.machine()} runs no programs for {name} (no qemu-{name} in {binfmt})"
    base = f"python:{_python_tag()}"
    if _run([*engine, "image", "inspect", "--format", "{{.Architecture}}", base])[0] != processor:
        said = _failure([*engine, "pull", "--platform", f"linux/{processor}", base])
        return said and f"its base image is not available: {said}"
    return ""


def build_image(engine: list[str], image: str, processor: str, version: str) -> tuple[bool, str]:
    """Build one image. Return True and its id, or False and the reason."""
    tag = f"linked-fleet/{image}:{version}-{processor}"
    given = [word for name in BUILD_ARGUMENTS if name in os.environ for word in ("--build-arg", name)]
    command = [*engine, "build", "--platform", f"linux/{processor}", "--target", image,
               "-f", f"deploy/{IMAGES[image]}", "-t", tag, *given, "."]  # fmt: skip
    if said := _failure(command):
        return False, said
    name, said = _run([*engine, "image", "inspect", "--format", "{{.Id}}", tag])
    return not said, said or name


def _python_tag() -> str:
    """Return the tag of the base image: PYTHON_TAG, as in compose, or that of the Dockerfiles."""
    (default,) = {
        line.partition("=")[2]
        for name in IMAGES.values()
        for line in (ROOT / "deploy" / name).read_text().splitlines()
        if line.startswith("ARG PYTHON_TAG=")
    }
    return os.environ.get("PYTHON_TAG") or default


def _failure(words: list[str]) -> str:
    """Run a command of the engine. Return the end of what it says if it fails, empty if it succeeds."""
    return _run(words)[1]


def _run(words: list[str]) -> tuple[str, str]:
    """Run a command of the engine. Return its output, and the end of what it says if it fails, else an empty string."""
    try:
        done = subprocess.run(  # noqa: S603 (the user's own engine, no shell)
            words,
            cwd=ROOT,
            env={**os.environ, **_WITH_HEALTH_CHECKS},
            capture_output=True,
            text=True,
            errors="replace",
            timeout=_LONGEST_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return "", str(error)
    if not done.returncode:
        return done.stdout.strip(), ""
    said = [line.strip() for line in (done.stderr or done.stdout).splitlines() if line.strip()]
    return "", f"{shlex.join(words)}: {' | '.join(said[-2:]) or f'exit code {done.returncode}'}"


def main() -> int:
    parser = argparse.ArgumentParser(prog="deploy/release_images.py", description="Build the images of a release.")
    parser.add_argument(
        "--engine", default="", help="docker, podman or another command (default: the first that works)"
    )
    engine = engine_command(parser.parse_args().engine)
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    failed = missing = 0
    for processor in PROCESSORS:
        reason = build_obstacle(engine, processor)
        for image in IMAGES:
            built, said = (False, reason) if reason else build_image(engine, image, processor, version)
            failed += not (built or reason)
            missing += not built
            print(
                f"{'built    ' if built else 'not built'}  linked-fleet/{image}:{version}-{processor}: {said}",
                flush=True,
            )
    if missing:
        print(f"{missing} of {len(IMAGES) * len(PROCESSORS)} images are missing in this release.")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
