"""Measures of the architecture: lines and modules of each layer, upward imports, import cycles.

``python -m bench.architecture`` prints them as Markdown (ARCHITECTURE.md, "Measures"). Imports inside functions and
under TYPE_CHECKING count. Blank lines, comments and docstrings are lines, but no code.
"""

import ast
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).parents[1]
EXTENSIONS = ROOT / "gateway/linked_fleet_gateway/extensions"
BESIDE = (
    "linked_fleet_base",
    "linked_fleet_runtime",
    "linked_fleet_rdf",
    "linked_fleet_identity",
    "linked_fleet_state",
    "linked_fleet_link",
    "linked_fleet_server",
    "linked_fleet_shacl",
    "linked_fleet_valkey",
    "linked_fleet_webhooks",
    "linked_fleet_doctor",
)
"""Packages beside the gateway: those that it uses, and the checks that use it."""
FOLDERS = dict.fromkeys(("linked_fleet_gateway", *BESIDE), "gateway") | {
    "linked_fleet_agent": "agents", "linked_fleet_client": "client", "linked_fleet_demo": "client",
    "bench": ".", "fuzzing": "tests",
}  # fmt: skip
"""The folder of each package."""
PACKAGES = {f"linked_fleet_{each}": each for each in ("base", "rdf", "runtime", "server", "state", "identity", "link")}
"""Packages through which a request passes, and what each is called in the tables."""
ROOMS = (
    "base", "rdf", "runtime", "server", "state", "identity", "link", "resources", "subscriptions", "actions",
    "http", "api", "faces", "serving", "extensions", "app",
)  # fmt: skip
"""Packages and layers ("rooms") of the gateway, the lowest first."""
Edges = Mapping[str, set[str]]


def modules(package: str) -> dict[str, Path]:
    """Return the Python modules of a package by their dotted names."""
    found: dict[str, Path] = {}
    folder = ROOT / FOLDERS[package]
    for path in sorted((folder / package).rglob("*.py")):
        if not {"node_modules", "tests"}.intersection(path.relative_to(folder).parts) and path.name != "conftest.py":
            name = ".".join(path.relative_to(folder).with_suffix("").parts)
            found[name.removesuffix(".__init__")] = path
    return found


def statements(source: str) -> int:
    """Return the number of lines without blank lines, comments and docstrings."""
    lines = source.splitlines()
    skipped = {number for number, line in enumerate(lines, 1) if not line.strip() or line.lstrip().startswith("#")}
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            skipped.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return len(lines) - len(skipped)


def imports(files: Mapping[str, Path]) -> dict[str, set[str]]:
    """Return the modules among ``files`` that each of them imports."""
    found: dict[str, set[str]] = {name: set() for name in files}
    for name, path in files.items():
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                named = [each.name for each in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module:
                named = [f"{node.module}.{each.name}" for each in node.names]
                named = [each if each in files else node.module for each in named]
            else:
                continue
            found[name] |= {each for each in named if each in files and each != name}
    return found


def scripts() -> dict[str, set[str]]:
    """Return the imports of the pages' scripts, and of those that extensions add."""
    found: dict[str, set[str]] = {}
    added = {str(path.relative_to(ROOT)) for path in EXTENSIONS.glob("*/scripts/page.js")}
    for path in sorted([*EXTENSIONS.glob("pages/scripts/src/*.js"), *EXTENSIONS.glob("*/scripts/*.js")]):
        named = re.findall(r"""(?:from|import)\s*\(?\s*["'](\.[^"']+)["']""", path.read_text())
        found[str(path.relative_to(ROOT))] = {
            str((path.parent / each).resolve().relative_to(ROOT.resolve())) for each in named
        }
        if re.search(r"""from ["']extensions["']""", path.read_text()):
            found[str(path.relative_to(ROOT))] |= added
    return found


def circles(edges: Edges) -> list[list[str]]:
    """Return the strongly connected components of more than one file (Tarjan), each sorted."""
    number: dict[str, int] = {}
    lowest: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(node: str) -> Iterator[str]:
        number[node] = lowest[node] = len(number)
        stack.append(node)
        for other in edges.get(node, ()):
            if other not in number:
                yield other
                lowest[node] = min(lowest[node], lowest[other])
            elif other in stack:
                lowest[node] = min(lowest[node], number[other])
        if lowest[node] == number[node]:
            first = stack.index(node)
            if len(stack) - first > 1:
                found.append(sorted(stack[first:]))
            del stack[first:]

    for start in edges:
        pending = [visit(start)] if start not in number else []
        while pending:
            following = next(pending[-1], None)
            if following is None:
                pending.pop()
            else:
                pending.append(visit(following))
    return found


def room_of(module: str) -> str:
    """Return the layer of a module of the gateway, or of a package below it; for an extension its name."""
    parts = module.split(".")
    if parts[0] in PACKAGES:
        return PACKAGES[parts[0]]
    if len(parts) < 2 or parts[1] == "__main__":
        return "app"
    return ".".join(parts[1:3]) if parts[1] == "extensions" and len(parts) > 2 else parts[1]


def rank(room: str) -> int:
    return ROOMS.index(room.partition(".")[0])


def upward(edges: Edges) -> list[tuple[str, str]]:
    """Return the gateway's imports into a higher layer, or between extensions."""
    found = []
    for module, imported in edges.items():
        for other in sorted(imported):
            one, two = room_of(module), room_of(other)
            if one != two and rank(two) >= rank(one):
                found.append((module, other))
    return found


def main() -> None:
    gateway = modules("linked_fleet_gateway")
    below = {name: path for package in PACKAGES for name, path in modules(package).items()}
    found_imports = imports(gateway | below)
    edges = {name: found_imports[name] for name in gateway}
    lines: Counter[str] = Counter()
    code: Counter[bool] = Counter()
    counts: Counter[str] = Counter()
    used: dict[str, set[str]] = defaultdict(set)
    for module, path in gateway.items():
        room = room_of(module)
        lines[room] += len(path.read_text().splitlines())
        code[room.startswith("extensions")] += statements(path.read_text())
        counts[room] += 1
        used[room] |= {room_of(each) for each in edges[module]} - {room}
    print("| room | modules | lines | imports |\n|---|---|---|---|")
    for room in sorted(lines, key=lambda each: (-rank(each), each)):
        if lines[room]:
            print(f"| `{room}` | {counts[room]} | {lines[room]:,} | {', '.join(sorted(used[room]))} |")
    extensions = sum(count for room, count in lines.items() if room.startswith("extensions"))
    core = sum(lines.values()) - extensions
    up = upward(edges)
    back = [each for each in up if not room_of(each[0]).startswith("extensions.")]
    every = {name: path for package in FOLDERS for name, path in modules(package).items()}
    found = circles(imports(every)) + circles(scripts())
    product = sum(len(modules(each)) for each in FOLDERS if each not in ("bench", "fuzzing"))
    print("\n| measure | |\n|---|---|")
    in_core = sum(count for room, count in counts.items() if not room.startswith("extensions"))
    print(f"| core of the gateway | {core:,} lines, {code[False]:,} of them code, in {in_core} modules |")
    print(f"| extensions | {extensions:,} lines, {code[True]:,} of them code |")
    for package in BESIDE:
        count = sum(len(path.read_text().splitlines()) for path in modules(package).values())
        print(f"| `{package}` | {count:,} lines |")
    print(f"| modules outside tests, bench and fuzz | {product} |")
    print(f"| imports of the core that run up | {len(back)} |")
    print(f"| imports from one extension to another | {len(up) - len(back)} |")
    print(f"| circles of files | {len(found)} |")
    for circle in found:
        print(f"\ncircle: {', '.join(circle)}")


if __name__ == "__main__":
    main()
