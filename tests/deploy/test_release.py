"""The packages of a release: reproducible, built from their own contents, and refused when damaged."""

import base64
import hashlib
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

from running import ROOT

pytestmark = [pytest.mark.processes, pytest.mark.test_all]

SCRIPTS = ROOT / "gateway/linked_fleet_gateway/extensions/pages/scripts"
VERSION = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
GATEWAY, AGENT = (f"{name}-{VERSION}-py3-none-any.whl" for name in ("linked_fleet", "linked_fleet_agent"))


def _release(*arguments: str | Path, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, ROOT / "deploy" / "release.py", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, **environment})


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("release")
    done = _release("--out", folder)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.fixture
def copied(built: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(built, tmp_path / "release"))


def test_a_release_has_an_sdist_a_wheel_and_a_bill_of_each_distribution(built: Path) -> None:
    """``sha256sum`` accepts them."""
    assert sorted(path.name for path in built.iterdir()) == sorted(
        ["SHA256SUMS"]
        + [f"{name}-{VERSION}{ending}" for name in ("linked_fleet", "linked_fleet_agent")
           for ending in (".cdx.json", ".tar.gz", "-py3-none-any.whl")]
    )  # fmt: skip
    listed = subprocess.run(
        ["sha256sum", "--check", "SHA256SUMS"], cwd=built, capture_output=True, text=True, check=True
    )
    assert listed.stdout.count(": OK") == 6


@pytest.mark.parametrize(("name", "wheel"), [("linked_fleet", GATEWAY), ("linked_fleet_agent", AGENT)])
def test_another_build_of_an_sdist_gives_the_same_wheel(built: Path, tmp_path: Path, name: str, wheel: str) -> None:
    """Date, time zone and file permissions change nothing: archive times are those of the last commit."""
    shutil.unpack_archive(built / f"{name}-{VERSION}.tar.gz", tmp_path)
    committed = subprocess.run(
        ["git", "log", "-1", "--format=%ct"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.strip()
    subprocess.run(
        [sys.executable, "-m", "build", "-q", "--no-isolation", "--wheel", "--outdir", tmp_path / "again",
         tmp_path / f"{name}-{VERSION}"],
        env={**os.environ, "SOURCE_DATE_EPOCH": committed, "TZ": "Asia/Tokyo"}, umask=0o077, check=True,
    )  # fmt: skip
    assert (tmp_path / "again" / wheel).read_bytes() == (built / wheel).read_bytes()


def test_a_build_that_differs_is_told(built: Path, copied: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "deploy"))
    import release  # type: ignore[import-not-found]

    release.compare_releases(built, copied)
    _replace(copied / AGENT, "linked_fleet_agent/robot.py", b"pass\n")
    (copied / GATEWAY).unlink()
    with pytest.raises(release.ReleaseError, match=f"{GATEWAY}, {AGENT}"):
        release.compare_releases(built, copied)


def test_sdists_hold_all_that_their_wheels_are_made_of_and_no_tests(built: Path) -> None:
    for wheel, name in ((GATEWAY, "linked_fleet"), (AGENT, "linked_fleet_agent")):
        with tarfile.open(built / f"{name}-{VERSION}.tar.gz") as archive:
            held = {path.partition("/")[2] for path in archive.getnames()}
        with zipfile.ZipFile(built / wheel) as archive:
            needed = {path for path in archive.namelist() if ".dist-info/" not in path}
        assert not [path for path in needed if "/scripts/" in path]
        assert needed and all(any(path == each or path.endswith(f"/{each}") for path in held) for each in needed)
        assert not [path for path in held if path.startswith(("tests/", "deploy/")) or "node_modules" in path]


def test_links_on_a_package_index_lead_to_files_of_this_version(built: Path) -> None:
    """By way of the redirects in ``deploy/w3id``."""
    with zipfile.ZipFile(built / GATEWAY) as archive:
        text = archive.read(f"linked_fleet-{VERSION}.dist-info/METADATA").decode()
    base, tag = "https://w3id.org/linked-fleet/", f"v{VERSION}/"
    targets = [target.removeprefix(base) for target in re.findall(r"\]\(([^)\s]+)\)", text) if target.startswith(base)]
    assert len(targets) == len(re.findall(r"\]\((?!https?:)", (ROOT / "README.md").read_text())) > 10
    rules = re.findall(r"^RewriteRule \^(\w+/)\(", (ROOT / "deploy/w3id/.htaccess").read_text(), re.M)
    for target in targets:
        (kind,) = (rule for rule in rules if target.startswith(rule + tag))
        assert (ROOT / target.removeprefix(kind + tag)).exists(), target


def test_both_distributions_have_the_same_licence() -> None:
    """Each is a regular file: a link would dangle in the sdist."""
    licences = [ROOT / "LICENSE", ROOT / "agents" / "LICENSE"]
    assert not any(path.is_symlink() for path in licences)
    assert len({path.read_text() for path in licences}) == 1


def test_the_bill_has_each_pinned_requirement_with_its_hash_and_what_pages_are_made_of(built: Path) -> None:
    bill = json.loads((built / f"linked_fleet-{VERSION}.cdx.json").read_text())
    parts = {part["purl"].partition("?")[0]: part for part in bill["components"]}
    pinned = [line.split(" ")[0] for line in (ROOT / "deploy/requirements.txt").read_text().splitlines()[1:]]
    assert {part["name"] + "==" + part["version"] for url, part in parts.items() if "pkg:pypi/" in url} == set(pinned)
    assert "SHA-256" in json.dumps(next(part for url, part in parts.items() if url.startswith("pkg:pypi/msgspec@")))
    wanted = json.loads((SCRIPTS / "package.json").read_text())["dependencies"]
    assert {part["name"] for url, part in parts.items() if url.startswith("pkg:npm/")} >= set(wanted)
    assert bill["metadata"]["component"]["name"] == "linked-fleet"


def _replace(wheel: Path, name: str, content: bytes | None) -> None:
    """Rewrite the wheel with another content of one file, or without it."""
    with zipfile.ZipFile(wheel) as archive:
        files = {info: archive.read(info) for info in archive.infolist()}
    with zipfile.ZipFile(wheel, "w") as archive:
        for info, old in files.items():
            if info.filename != name:
                archive.writestr(info, old)
            elif content is not None:
                archive.writestr(info, content)


def _summed(folder: Path) -> None:
    """Recompute the list of sums."""
    files = sorted(path for path in folder.iterdir() if path.name != "SHA256SUMS")
    lines = [f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in files]
    (folder / "SHA256SUMS").write_text("".join(lines))


def test_a_built_release_passes_the_check(built: Path) -> None:
    done = _release("--check", built)
    assert done.returncode == 0, done.stderr


def test_a_file_that_its_sum_does_not_fit_is_refused(copied: Path) -> None:
    wheel = copied / AGENT
    content = bytearray(wheel.read_bytes())
    content[len(content) // 2] ^= 1
    wheel.write_bytes(content)
    done = _release("--check", copied)
    assert done.returncode == 1 and f"SHA256SUMS does not agree with {AGENT}" in done.stderr


@pytest.mark.parametrize(
    ("wheel", "name", "content", "reason"),
    [
        (AGENT, "linked_fleet_agent/robot.py", b"import os\n", "robot.py"),
        (GATEWAY, "linked_fleet_client/fleet.py", None, "fleet.py"),
        (AGENT, f"linked_fleet_agent-{VERSION}.dist-info/RECORD", b"", "is damaged"),
    ],
    ids=["another content", "a file less", "no record"],
)
def test_a_damaged_wheel_is_refused(copied: Path, wheel: str, name: str, content: bytes | None, reason: str) -> None:
    """The hashes in the wheel itself reveal the damage, even if the list of sums was recomputed."""
    _replace(copied / wheel, name, content)
    _summed(copied)
    done = _release("--check", copied)
    assert done.returncode == 1, done.stdout
    assert f"{wheel} is damaged" in done.stderr and reason in done.stderr


def test_a_description_with_relative_links_is_refused(copied: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "deploy"))
    import release

    name, record = (f"linked_fleet_agent-{VERSION}.dist-info/{each}" for each in ("METADATA", "RECORD"))
    with zipfile.ZipFile(copied / AGENT) as archive:
        text = archive.read(name) + b"[pages](docs/TUTORIAL.md)\n"
        listed = archive.read(record).decode()
    digest = base64.urlsafe_b64encode(hashlib.sha256(text).digest()).decode().rstrip("=")
    _replace(copied / AGENT, name, text)
    _replace(copied / AGENT, record, re.sub(f"{name},.*", f"{name},sha256={digest},{len(text)}", listed).encode())
    _summed(copied)
    with pytest.raises(release.ReleaseError, match=r"lead nowhere on a package index: docs/TUTORIAL\.md"):
        release.check_release(copied)


def test_a_missing_file_is_refused(copied: Path) -> None:
    (copied / GATEWAY).unlink()
    _summed(copied)
    done = _release("--check", copied)
    assert done.returncode == 1 and f"{GATEWAY} is missing" in done.stderr


_ENGINE = """#!/bin/sh
case "$*" in
  *$FAILS*) echo "no space left on device" >&2; exit 1 ;;
  *inspect*) echo sha256:0123 ;;
esac
"""


def _images(engine: str, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, ROOT / "deploy" / "release_images.py", "--engine", engine]
    return subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, **environment})


def test_images_that_could_not_be_built_are_told_with_the_reason(tmp_path: Path) -> None:
    """A script replaces the engine, which cannot build one of the images."""
    engine = tmp_path / "engine"
    engine.write_text(_ENGINE)
    engine.chmod(0o755)
    own = {"x86_64": "amd64", "aarch64": "arm64"}[platform.machine()]
    done = _images(str(engine), FAILS=f"linked-fleet/gateway:{VERSION}-{own}")
    assert done.returncode == 1
    assert f"not built  linked-fleet/gateway:{VERSION}-{own}: " in done.stdout and "no space left" in done.stdout
    assert f"built      linked-fleet/agent:{VERSION}-{own}: sha256:0123" in done.stdout


def test_podman_keeps_the_health_checks_of_images(tmp_path: Path) -> None:
    """A script replaces podman, which drops them unless it is told the format."""
    engine = tmp_path / "engine"
    engine.write_text(
        '#!/bin/sh\n[ "$1" != build ] || [ "$BUILDAH_FORMAT" = docker ] || { echo dropped >&2; exit 1; }\n'
    )
    engine.chmod(0o755)
    done = _images(str(engine), BUILDAH_FORMAT="")
    assert done.returncode == 0 and "dropped" not in done.stdout, done.stdout


def test_an_image_for_a_processor_whose_programs_do_not_run_here_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "deploy"))
    import release_images  # type: ignore[import-not-found]

    own, other = platform.machine(), "aarch64" if platform.machine() == "x86_64" else "x86_64"
    names = {kernel: name for name, kernel in release_images.PROCESSORS.items()}
    assert release_images.build_obstacle(["true"], names[own], tmp_path) == ""
    assert f"runs no programs for {other}" in release_images.build_obstacle(["true"], names[other], tmp_path)
    (tmp_path / f"qemu-{other}").touch()
    assert release_images.build_obstacle(["true"], names[other], tmp_path) == ""
    assert "base image is not available" in release_images.build_obstacle(["false"], names[own], tmp_path)


def test_a_base_image_for_another_processor_does_not_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A script replaces the engine, which has the image for one processor and reaches no registry."""
    monkeypatch.syspath_prepend(str(ROOT / "deploy"))
    import release_images

    own = {"x86_64": "amd64", "aarch64": "arm64"}[platform.machine()]
    (other,) = release_images.PROCESSORS.keys() - {own}
    (tmp_path / f"qemu-{release_images.PROCESSORS[other]}").touch()
    engine = tmp_path / "engine"
    engine.write_text(f'#!/bin/sh\ncase "$*" in *inspect*) echo {own} ;; *) echo "no such host" >&2; exit 1 ;; esac\n')
    engine.chmod(0o755)
    assert release_images.build_obstacle([str(engine)], own, tmp_path) == ""
    assert "base image is not available" in release_images.build_obstacle([str(engine)], other, tmp_path)


def test_without_an_engine_no_image_is_built_and_that_is_told(tmp_path: Path) -> None:
    done = _images("", PATH=str(tmp_path))
    assert done.returncode == 0
    assert done.stdout.count("not built") == 6 and "neither docker nor podman" in done.stdout
