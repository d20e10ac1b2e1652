"""Lists what an image contains besides the base image: an SBOM (CycloneDX JSON) and third-party licences.

Usage: PYTHON deploy/bill_of_materials.py FOLDER [FACE]

Writes into FOLDER. FACE contains the npm packages of the pages.
"""

import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import Distribution, distributions
from pathlib import Path
from typing import Any

OWN_PACKAGES = "linked-fleet"
_LICENCE_FILES = ("licen", "copying", "notice", "authors")


@dataclass(frozen=True, order=True)
class Part:
    """One package. ``licence``: as in its metadata; ``texts``: its licence files."""

    kind: str
    name: str
    version: str
    licence: str
    texts: tuple[str, ...] = ()

    @property
    def purl(self) -> str:
        """Package URL (https://github.com/package-url/purl-spec)."""
        return f"pkg:{self.kind}/{self.name.replace('@', '%40')}@{self.version}"


def python_parts() -> Iterator[Part]:
    """Yield the distributions of the running environment."""
    for distribution in distributions():
        name = distribution.metadata["Name"].lower().replace("_", "-")
        yield Part("pypi", name, distribution.version, _python_licence(distribution), _python_texts(distribution))


def npm_parts(face: Path) -> Iterator[Part]:
    """Yield the runtime dependencies of ``pages/scripts/package.json``, transitively; build tools are left out."""
    waiting, seen = list(_json(face / "package.json").get("dependencies", {})), set[str]()
    while waiting:
        name = waiting.pop()
        folder = face / "node_modules" / name
        if name in seen or not folder.is_dir():  # a missing optional package is not in the bundle
            continue
        seen.add(name)
        package = _json(folder / "package.json")
        waiting += package.get("dependencies", {})
        texts = tuple(_read(file) for file in sorted(folder.iterdir()) if _is_licence(file))
        yield Part("npm", name, package["version"], str(package.get("license", "unknown")), texts)


def build_bill(parts: list[Part]) -> dict[str, Any]:
    """Return CycloneDX 1.6, without a time or serial number, so that the same parts give the same bytes."""
    ours = [part for part in parts if part.name == OWN_PACKAGES]
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"component": {"type": "application", **component(ours[0])}} if ours else {},
        "components": [{"type": "library", **component(part)} for part in parts if part not in ours],
    }


def licences(parts: list[Part]) -> str:
    third = [part for part in parts if part.name != OWN_PACKAGES]
    listed = "\n".join(f"{part.name} {part.version}: {part.licence}" for part in third)
    texts = "\n".join(f"\n{'=' * 78}\n{part.name} {part.version}\n\n{text}" for part in third for text in part.texts)
    return f"Packages of third parties in this image, besides those of its base image.\n\n{listed}\n{texts}\n"


def component(part: Part) -> dict[str, Any]:
    return {
        "bom-ref": part.purl,
        "name": part.name,
        "version": part.version,
        "purl": part.purl,
        "licenses": [{"license": {"name": part.licence}}],
    }


def _python_licence(distribution: Distribution) -> str:
    """Return the licence expression, else the first line of the free text, else the classifiers."""
    metadata: Any = distribution.metadata  # an email.message.Message, which its type does not say
    stated = (metadata.get("License-Expression") or metadata.get("License") or "").strip().splitlines()
    classifiers = [c.rpartition(" :: ")[2] for c in metadata.get_all("Classifier") or [] if c.startswith("License ::")]
    return stated[0] if stated else ", ".join(classifiers) or "unknown"


def _python_texts(distribution: Distribution) -> tuple[str, ...]:
    paths = [Path(str(path.locate())) for path in distribution.files or [] if ".dist-info" in str(path)]
    return tuple(_read(path) for path in sorted(paths) if _is_licence(path))


def _is_licence(path: Path) -> bool:
    return path.is_file() and path.name.lower().startswith(_LICENCE_FILES)


def _read(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="replace")


def _json(path: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return content


def main() -> int:
    if len(sys.argv) not in (2, 3):
        print(__doc__, file=sys.stderr)
        return 2
    folder = Path(sys.argv[1])
    parts = sorted([*python_parts(), *(npm_parts(Path(sys.argv[2])) if len(sys.argv) == 3 else ())])
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "sbom.cdx.json").write_text(json.dumps(build_bill(parts), indent=1) + "\n")
    (folder / "THIRD-PARTY-LICENCES.txt").write_text(licences(parts))
    return 0


if __name__ == "__main__":
    sys.exit(main())
