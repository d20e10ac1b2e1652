"""Extensions are disabled and loaded by name, and each has its own section of settings."""

import sys
import textwrap
from collections.abc import Callable
from pathlib import Path

import httpx
import pytest

import linked_fleet_gateway.extensions
from linked_fleet_gateway.app.extensions import BUILT_IN, ExtensionSettings, dependency_order, enabled_extensions
from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_gateway.extensions.history.extension import HistorySettings
from linked_fleet_gateway.extensions.rules.extension import RuleSettings
from linked_fleet_gateway.http.extension import Extension
from running import process
from small_fleet import Place

pytestmark = pytest.mark.virtual

PATHS = ("/query", "/world", "/rules", "/things", "/ur5/history", "/.well-known/wot")
BUILT_NAMES = [each.name for each in BUILT_IN]
Package = Callable[..., None]
_GRIPPER = """
    from contextlib import asynccontextmanager
    from dataclasses import dataclass
    from typing import ClassVar
    from linked_fleet_base.settings import Section, setting, whole_number
    from linked_fleet_gateway.http.extension import Extension, Mount

    @dataclass(frozen=True)
    class GripperSettings(Section):
        prefix: ClassVar[str] = "ACME_"
        force_n: int = setting(whole_number(1, 100), "5", "its force")

    class Gripper(Extension):
        name, needs, settings = "gripper", {needs}, GripperSettings

        @asynccontextmanager
        async def start(self, core):
            force_n = core.section(GripperSettings).force_n
            yield Mount(formats={{f"force{{force_n}}": ("Force", "text/force")}})
"""


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Package:
    """Install a package with an extension."""
    monkeypatch.syspath_prepend(str(tmp_path))

    def install(
        entry: str, needs: tuple[str, ...] = (), distribution: str = "acme", module: str = "acme_gripper"
    ) -> None:
        (tmp_path / f"{module}.py").write_text(textwrap.dedent(_GRIPPER).format(needs=needs))
        metadata = tmp_path / f"{distribution}-1.dist-info"
        metadata.mkdir()
        (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 1\n")
        (metadata / "entry_points.txt").write_text(f"[linked_fleet.extensions]\n{entry}\n")
        monkeypatch.delitem(sys.modules, module, raising=False)

    return install


def names(*flags: str) -> list[str]:
    return [each.name for each in enabled_extensions(GatewaySettings.read({}, flags).section(ExtensionSettings))]


def test_every_folder_is_an_extension_of_its_name_and_each_comes_after_those_that_it_needs() -> None:
    (path,) = linked_fleet_gateway.extensions.__path__
    assert sorted(each.name for each in Path(path).iterdir() if (each / "__init__.py").exists()) == BUILT_NAMES
    assert [type(each).__module__.split(".")[2] for each in BUILT_IN] == BUILT_NAMES
    order = names()
    assert sorted(order) == BUILT_NAMES
    assert all(order.index(need) < order.index(each.name) for each in BUILT_IN for need in each.needs)


def test_sections_of_extensions_are_read_with_that_of_the_core() -> None:
    settings = GatewaySettings.read(
        {"LINKED_FLEET_HISTORY_S": "60", "LINKED_FLEET_RULES_PER_CLIENT": "7"}, ["--history-hz=1"]
    )
    assert settings.section(HistorySettings) == HistorySettings(s=60, hz=1)
    assert settings.section(RuleSettings).per_client == 7
    assert GatewaySettings().section(HistorySettings) == HistorySettings(300, 10, 24)


def test_a_disabled_extension_is_absent_and_its_settings_are_ignored() -> None:
    assert set(BUILT_NAMES) - set(names("--extensions-off", "history, things", "--history-s", "5")) == {
        "history",
        "things",
    }
    assert "history" not in [each.name for each in enabled_extensions(ExtensionSettings(extensions_off=("history",)))]


def test_an_extension_comes_after_those_that_it_uses_and_needs_none_of_them() -> None:
    class Camera(Extension):
        name = "camera"

    class Viewer(Extension):
        name, uses = "viewer", ("camera", "map")

    assert [each.name for each in dependency_order([Viewer(), Camera()])] == ["camera", "viewer"]
    assert [each.name for each in dependency_order([Viewer()])] == ["viewer"]


def test_a_built_in_extension_whose_package_is_not_installed_is_off(monkeypatch: pytest.MonkeyPatch) -> None:
    (history,) = (each for each in BUILT_IN if each.name == "history")
    monkeypatch.setattr(type(history), "modules", ("no_such_package",))
    assert set(BUILT_NAMES) - set(names()) == {"history"}


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (("--extensions-off", "world,sun"), "LINKED_FLEET_EXTENSIONS_OFF is of audit, .*, world, not sun$"),
        (
            ("--extensions-off", "query"),
            "LINKED_FLEET_EXTENSIONS_OFF names query, which missions needs: switch missions off as",
        ),
        (("--extensions", "world"), "LINKED_FLEET_EXTENSIONS is of extensions of other packages; world is built in"),
        (("--extensions", "sun"), "LINKED_FLEET_EXTENSIONS names 'sun', which no installed packages have; .*: none"),
    ],
)
def test_names_that_cannot_be_meant_are_refused(flags: tuple[str, ...], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        GatewaySettings.read({}, flags)


def test_a_foreign_extension_is_loaded_only_if_it_is_named(package: Package) -> None:
    package("gripper = acme_gripper:Gripper", ("query",))
    assert "gripper" not in names()
    assert "gripper" in names("--extensions", "gripper")
    with pytest.raises(ValueError, match="names query, which gripper needs"):
        names("--extensions", "gripper", "--extensions-off", "query,rules,missions,queue")
    with pytest.raises(ValueError, match=r"names 'hand', which no installed packages have; .*: gripper$"):
        names("--extensions", "hand")
    with pytest.raises(ValueError, match="ACME_FORCE_N is a whole number from 1 to 100, not '0'"):
        GatewaySettings.read({"ACME_FORCE_N": "0"}, ["--extensions", "gripper"])


def test_a_foreign_extension_that_lacks_another_is_refused(package: Package) -> None:
    package("gripper = acme_gripper:Gripper", ("sun",))
    with pytest.raises(ValueError, match="extensions lack others, or need each other: gripper needs sun"):
        names("--extensions", "gripper")


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("gripper = acme_gripper:NOTHING", "names 'gripper', which cannot be imported: .*NOTHING"),
        (
            "gripper = acme_nothing:Gripper",
            "names 'gripper', which cannot be imported: No module named 'acme_nothing'",
        ),
        ("gripper = acme_gripper:GripperSettings", "the entry point 'gripper' .* is no extension of that name"),
        ("claw = acme_gripper:Gripper", "the entry point 'claw' .* is no extension of that name: acme_gripper:Gripper"),
    ],
)
def test_an_entry_point_that_is_none_is_refused(package: Package, entry: str, said: str) -> None:
    package(entry)
    with pytest.raises(ValueError, match=said):
        names("--extensions", entry.partition(" ")[0])


def test_a_name_of_two_packages_is_refused(package: Package) -> None:
    package("gripper = acme_gripper:Gripper")
    package("gripper = acme_gripper:Gripper", distribution="other")
    with pytest.raises(ValueError, match="names 'gripper', which several installed packages have"):
        names("--extensions", "gripper")


def test_a_gateway_has_a_foreign_extension_with_its_settings(package: Package, tmp_path: Path) -> None:
    package("gripper = acme_gripper:Gripper")
    place = Place(tmp_path / "state")
    with process(*place.command(), "--extensions", "gripper", "--acme-force-n", "9") as one:
        one.said("serving")
        with httpx.Client(base_url=place.root) as client:
            assert client.get("/?as=other").json()["detail"].endswith(", force9.")


@pytest.mark.parametrize(("off", "status"), [([], 200), (BUILT_NAMES, 404)])
def test_the_core_serves_with_every_extension_off(tmp_path: Path, off: list[str], status: int) -> None:
    place = Place(tmp_path)
    with process(*place.command(), "--extensions-off", ",".join(off)) as one, place.ur5():
        one.said("robot ur5: described")
        with httpx.Client(base_url=place.root) as client:
            assert "<ur5/>" in client.get("/", headers={"accept": "text/turtle"}).text
            assert client.get("/ur5/elbow_joint/actions/rotate").status_code == 200
            assert client.get("/", headers={"accept": "text/html"}).status_code == (406 if off else 200)
            assert {path: client.get(path).status_code for path in PATHS} == dict.fromkeys(PATHS, status)
