"""Every command of the pages for users, run against the demo as shipped; a page says why it cannot be run."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from demonstration import Demo, running_demo
from running import ROOT, free_port
from transcript import Command, Shell, matches, ports_of, steps

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
_DEMO_PORT = "8000"
_EXTENSIONS = ROOT / "gateway/linked_fleet_gateway/extensions"
_FIRST = (ROOT / "README.md", ROOT / "docs" / "TUTORIAL.md")
"""They run as a newcomer runs them: the UR5 still sways."""
_PAGES = [
    *_FIRST,
    *sorted({
        *(ROOT / "docs").glob("*.md"), *(ROOT / "client").glob("*.md"), *(ROOT / "deploy").rglob("*.md"),
        *(ROOT / "gateway" / "linked_fleet_gateway").glob("*/*.md"), *_EXTENSIONS.glob("*/README.md"),
        *(ROOT / folder / "README.md" for folder in ("agents", "shapes", "examples")),
    } - {*_FIRST}),
]  # fmt: skip
_ALONE = (_EXTENSIONS / "world/README.md", ROOT / "docs" / "FLOOR.md")
"""They put things next to robots that other pages move."""
_PAGES.sort(key=lambda page: page not in _ALONE)


def _commands(page: Path) -> list[Command]:
    return [step for step in steps(page.read_text()) if isinstance(step, Command)]


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Demo]:
    with running_demo(tmp_path_factory.mktemp("demo")) as demo:
        yield demo


@pytest.fixture
def demo(page: Path, tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Iterator[Demo]:
    if page in _ALONE:
        with running_demo(tmp_path_factory.mktemp("demo")) as demo:
            yield demo
    else:
        yield request.getfixturevalue("shared")


@pytest.fixture
def shell(demo: Demo, tmp_path: Path, page: Path) -> Iterator[Shell]:
    ports = {named: str(free_port()) for named in ports_of(page.read_text())} | {_DEMO_PORT: str(demo.port)}
    shell = Shell(tmp_path, ports)
    try:
        yield shell
    finally:
        shell.close()


@pytest.mark.parametrize(
    "page", [page for page in _PAGES if _commands(page)], ids=lambda page: str(page.relative_to(ROOT))
)
def test_commands_print_what_the_page_shows(page: Path, shell: Shell, demo: Demo) -> None:
    """Each command of the page succeeds, and its output is the one shown, times, ids and measurements masked."""
    wrong = []
    for step in steps(page.read_text()):
        if not isinstance(step, Command):
            shell.write(step)
            continue
        if step.text.startswith("make demo"):
            said, status = demo.output.replace(str(demo.port), _DEMO_PORT), 0
        else:
            said, status = shell.run(step)
        where = f"{page.name}, line {step.line}: {step.text}"
        if step.output is None:
            if status:
                wrong.append(f"{where}\nexit status {status}\n{said}")
        elif not matches(step.output, said):
            wrong.append(f"{where}\n-- the page\n{step.output}\n-- the command\n{said}")
    assert not wrong, "\n".join(wrong)
