"""Builds the packages of a release and checks them: make release

Usage: PYTHON deploy/release.py [--out FOLDER]
       PYTHON deploy/release.py --check FOLDER

Builds sdists, wheels from them, a bill of materials (CycloneDX) for each, and SHA256SUMS. Everything is built a second
time elsewhere, from the contents of the sdists alone, and must be identical to the byte. FOLDER is only changed if
every check passes. ``--check`` checks existing files.
"""

import argparse
import hashlib
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from bill_of_materials import component, npm_parts
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator
from installer.records import parse_record_file
from installer.sources import WheelFile

ROOT = Path(__file__).parents[1]
SCRIPTS = ROOT / "gateway/linked_fleet_gateway/extensions/pages/scripts"
PROJECTS = {"linked-fleet-agent": ROOT / "agents", "linked-fleet": ROOT}
SUMS = "SHA256SUMS"
_REQUIREMENTS = {"linked-fleet-agent": "requirements-agent.txt", "linked-fleet": "requirements.txt"}
_PAGES = "linked_fleet_gateway/extensions/pages/assets/manifest.json"
_OURS = ("linked_fleet*", SUMS)
_RELATIVE_LINK = re.compile(r"\]\((?!\w+:|#)([^)\s]+)")
"""A link of Markdown; its target is the group."""
_REDIRECTS = ROOT / "deploy" / "w3id" / ".htaccess"
_EXAMPLES = {
    "code.example": "the repository: links on a package index lead nowhere",
    "fleet.example": "a public gateway: IRIs of the vocabulary lead nowhere",
}
"""Hosts in the redirects that a publisher replaces."""
_LONGEST_S = 600


class ReleaseError(Exception):
    """A release that must not be published; the message says why."""


def time_of_last_commit() -> str:
    """Return the time for archives in seconds since 1970: SOURCE_DATE_EPOCH, or that of the last commit."""
    return os.environ.get("SOURCE_DATE_EPOCH") or _run("git", "log", "-1", "--format=%ct").strip()


def build_release(out: Path) -> None:
    """Build everything, check it, and replace an earlier release in ``out``."""
    epoch = time_of_last_commit()
    with tempfile.TemporaryDirectory() as folder:
        first, second = Path(folder, "first"), Path(folder, "second")
        for project in PROJECTS.values():
            _build(project, first, epoch)
        for sdist in sorted(first.glob("*.tar.gz")):
            shutil.unpack_archive(sdist, folder)
            _build(Path(folder, sdist.name.removesuffix(".tar.gz")), second, epoch, umask=0o077)
        compare_releases(first, second)
        for name in PROJECTS:
            (first / f"{_stem(name)}.cdx.json").write_text(bill_of_materials(name))
        write_checksums(first)
        check_release(first)
        out.mkdir(parents=True, exist_ok=True)
        for earlier in (path for pattern in _OURS for path in out.glob(pattern)):
            earlier.unlink()
        for path in [*_files(first), first / SUMS]:
            shutil.copyfile(path, out / path.name)


def compare_releases(first: Path, second: Path) -> None:
    """Raise ReleaseError unless both folders contain the same files."""
    names = {path.name for folder in (first, second) for path in _files(folder)}
    differing = [name for name in sorted(names) if _digest(first / name) != _digest(second / name)]
    if differing:
        raise ReleaseError(f"a second build gives other bytes: {', '.join(differing)}")


def bill_of_materials(name: str) -> str:
    """Return the pinned requirements of a distribution, with hashes, and the npm packages of its pages."""
    project, requirements = PROJECTS[name], ROOT / "deploy" / _REQUIREMENTS[name]
    flags = ("--sv", "1.6", "--of", "JSON", "--output-reproducible", "--mc-type", "application")
    command = ("-m", "cyclonedx_py", "requirements", str(requirements), "--pyproject", str(project / "pyproject.toml"))
    bill = json.loads(_run(sys.executable, *command, *flags))
    if project == ROOT:
        bill["components"] += [{"type": "library", **component(part)} for part in sorted(npm_parts(SCRIPTS))]
    text = json.dumps(bill, indent=1) + "\n"
    error = JsonStrictValidator(SchemaVersion.V1_6).validate_str(text)
    if error is not None:
        raise ReleaseError(f"the bill of materials of {name} is not CycloneDX: {error}")
    return text


def write_checksums(folder: Path) -> None:
    """Write SHA256SUMS for ``sha256sum --check``."""
    (folder / SUMS).write_text("".join(f"{_digest(path)}  {path.name}\n" for path in _files(folder)))


def check_release(folder: Path) -> None:
    """Raise ReleaseError with all faults of the files of a release."""
    wrong = [*_missing(folder), *_wrong_sums(folder)]
    packages = [str(path) for path in _files(folder) if path.suffix in (".whl", ".gz")]
    for wheel in sorted(folder.glob("*.whl")):
        wrong += _wrong_wheel(wheel)
    if not wrong:
        wrong += _refused("twine", "check", "--strict", *packages)
        for name, project in PROJECTS.items():
            settings, wheel = project / "pyproject.toml", folder / f"{_stem(name)}-py3-none-any.whl"
            wrong += _refused("check_wheel_contents", "--config", str(settings), str(wheel))
            wrong += _refused("validate_pyproject", str(settings))
    if wrong:
        raise ReleaseError("\n".join(wrong))


def publication_obstacles() -> Iterable[str]:
    """Yield each reason why a release that passes all checks must not be published yet."""
    if _run("git", "status", "--porcelain"):
        yield "there are changes that are not committed"
    rules = re.findall(r"^RewriteRule .+$", _REDIRECTS.read_text(), re.MULTILINE)
    for host, meaning in _EXAMPLES.items():
        if any(f"https://{host}/" in rule for rule in rules):
            place = _REDIRECTS.relative_to(ROOT)
            yield f"{place} has {host} in the place of {meaning}"


def distribution_version(name: str) -> str:
    """Return the version of one of this project's distributions."""
    return str(_settings(name)["version"])


def _stem(name: str) -> str:
    """Return the common beginning of a distribution's file names."""
    return f"{name.replace('-', '_')}-{distribution_version(name)}"


def _settings(name: str) -> dict[str, Any]:
    project: dict[str, Any] = tomllib.loads((PROJECTS[name] / "pyproject.toml").read_text())["project"]
    return project


def _missing(folder: Path) -> Iterable[str]:
    """Yield what is missing: both distributions must have the same version, and an sdist, a wheel and a bill."""
    versions = {name: distribution_version(name) for name in PROJECTS}
    if len(set(versions.values())) > 1:
        yield f"the distributions have different versions: {versions}"
    needed = re.findall(r"linked-fleet-agent\[\w+\]==([\d.\w]+)", " ".join(_settings("linked-fleet")["dependencies"]))
    if needed != [versions["linked-fleet-agent"]]:
        yield f"linked-fleet needs linked-fleet-agent {needed}, and not {versions['linked-fleet-agent']}"
    for name in PROJECTS:
        for ending in (".tar.gz", "-py3-none-any.whl", ".cdx.json"):
            if not (folder / f"{_stem(name)}{ending}").is_file():
                yield f"{_stem(name)}{ending} is missing"


def _wrong_sums(folder: Path) -> Iterable[str]:
    if not (folder / SUMS).is_file():
        return [f"{SUMS} is missing"]
    listed = dict(reversed(line.split("  ", 1)) for line in (folder / SUMS).read_text().splitlines())
    found = {path.name: _digest(path) for path in _files(folder)}
    return [f"{SUMS} does not agree with {name}" for name in sorted(dict(listed.items() ^ found.items()))]


def _wrong_wheel(path: Path) -> list[str]:
    """Compare the files of a wheel with its RECORD."""
    try:
        with WheelFile.open(path) as wheel:
            wheel.validate_record(validate_contents=True)
            listed = {name for name, _, _ in parse_record_file(wheel.read_dist_info("RECORD").splitlines())}
            description = wheel.read_dist_info("METADATA").partition("\n\n")[2]
        with zipfile.ZipFile(path) as archive:
            names = set(archive.namelist())
    except (ValueError, OSError, KeyError, zipfile.BadZipFile, zlib.error) as error:
        return [f"{path.name} is damaged: {error}"]
    if listed - names:
        return [f"{path.name} is damaged: it has no {', '.join(sorted(listed - names))}"]
    if path.name.startswith("linked_fleet-") and _PAGES not in names:
        return [f"{path.name} has no scripts of the pages: make assets"]
    if relative := _RELATIVE_LINK.findall(description):
        return [f"{path.name} has links that lead nowhere on a package index: {', '.join(relative)}"]
    return []


def _refused(module: str, *arguments: str) -> list[str]:
    try:
        _run(sys.executable, "-m", module, *arguments)
    except ReleaseError as error:
        return [str(error)]
    return []


def _build(project: Path, out: Path, epoch: str, umask: int = 0o022) -> None:
    """Build an sdist, and a wheel from it, with the pinned build backend of this environment."""
    environment = {**os.environ, "SOURCE_DATE_EPOCH": epoch}
    command = (sys.executable, "-m", "build", "--no-isolation", "--outdir", str(out), str(project))
    _run(*command, environment=environment, umask=umask)


def _run(*words: str, environment: dict[str, str] | None = None, umask: int = -1) -> str:
    """Return the output of a program. Raises ReleaseError with all output if it fails."""
    done = subprocess.run(  # noqa: S603 (our own words, no shell)
        words, cwd=ROOT, env=environment, umask=umask, capture_output=True, text=True, timeout=_LONGEST_S, check=False
    )
    if done.returncode:
        raise ReleaseError(f"{shlex.join(words)}\n{done.stdout}{done.stderr}".rstrip())
    return done.stdout


def _files(folder: Path) -> list[Path]:
    """Return the files of a release except the sums, sorted by name."""
    return sorted(path for path in folder.iterdir() if path.match(_OURS[0]))


def _digest(path: Path) -> str | None:
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else None


def main() -> int:
    parser = argparse.ArgumentParser(prog="deploy/release.py", description="Build the packages of a release.")
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="where they go (default: dist)")
    parser.add_argument("--check", type=Path, metavar="FOLDER", help="check the files there and build nothing")
    arguments = parser.parse_args()
    folder = arguments.check or arguments.out
    try:
        check_release(folder) if arguments.check else build_release(folder)
    except ReleaseError as error:
        print(f"release: {error}", file=sys.stderr)
        return 1
    for path in [*_files(folder), folder / SUMS]:
        print(f"{path.stat().st_size:>10,}  {path}")
    if not arguments.check:
        for reason in publication_obstacles():
            print(f"Not for publication: {reason}.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
