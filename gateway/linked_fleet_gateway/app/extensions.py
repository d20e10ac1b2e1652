"""Discovery, ordering and mounting of extensions.

The folders of ``extensions`` are the built-in ones, each with a class in ``extension.py``. They are found without
package metadata, which may be outdated in a checkout. Foreign ones are found by their entry points.
"""

import logging
import pkgutil
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass, replace
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import TypeGuard

import linked_fleet_gateway.extensions
from linked_fleet_base.contributions import CORE_AT_ROOT, CORE_IN_ROBOT, Contributions, using
from linked_fleet_base.errors import MotionRefused
from linked_fleet_base.settings import TEXTS, Section, setting
from linked_fleet_gateway.actions.plan import Motion
from linked_fleet_gateway.http.extension import Core, Extension, Mount
from linked_fleet_gateway.http.representation import Representations
from linked_fleet_gateway.resources.action_offer import action_definitions
from linked_fleet_gateway.resources.html import NavigationEntry
from linked_fleet_identity.rights import View
from linked_fleet_rdf.shapes import ACTIONS, BLUEPRINTS, VOCABULARY, load_turtle_file
from linked_fleet_rdf.vocabulary import LF
from linked_fleet_state.robot import Robot

log = logging.getLogger(__name__)
GROUP = "linked_fleet.extensions"
"""Entry point group of extensions in other packages; each names a subclass of ``Extension`` by its own name."""


@dataclass(frozen=True)
class ExtensionSettings(Section):
    """Selection of the extensions of a gateway."""

    extensions: tuple[str, ...] = setting(TEXTS, "", "names of extensions of other packages to load, comma-separated")
    extensions_off: tuple[str, ...] = setting(
        TEXTS,
        "",
        "names of built-in extensions to switch off (docs/SETTINGS.md#extensions), comma-separated",
    )


def _built_in() -> Iterator[Extension]:
    for folder in pkgutil.iter_modules(linked_fleet_gateway.extensions.__path__):
        module = f"{linked_fleet_gateway.extensions.__name__}.{folder.name}.extension"
        if folder.ispkg and find_spec(module):
            (kind,) = (each for each in vars(import_module(module)).values() if _is_extension(each))
            yield kind()


def _is_extension(value: object) -> TypeGuard[type[Extension]]:
    return isinstance(value, type) and issubclass(value, Extension) and value is not Extension


BUILT_IN: Sequence[Extension] = tuple(_built_in())


def enabled_extensions(settings: ExtensionSettings) -> list[Extension]:
    """Return the extensions of a gateway with these settings.

    Raises ValueError for an unknown name, and for an extension that needs one that is off.
    """
    names, off = [each.name for each in BUILT_IN], settings.extensions_off
    if unknown := [name for name in off if name not in names]:
        raise ValueError(f"LINKED_FLEET_EXTENSIONS_OFF is of {', '.join(names)}, not {', '.join(unknown)}")
    found = [
        *(each for each in BUILT_IN if each.name not in off and not missing_requirements(each)),
        *foreign_extensions(settings),
    ]
    for each in found:
        if missing := [name for name in each.needs if name in off]:
            raise ValueError(
                f"LINKED_FLEET_EXTENSIONS_OFF names {missing[0]}, which {each.name} needs: "
                f"switch {each.name} off as well, or neither"
            )
    return dependency_order(found)


def missing_requirements(extension: Extension) -> list[str]:
    """Return the optional packages that the extension needs and that are not installed."""
    return [name for name in extension.modules if find_spec(name) is None]


def foreign_extensions(settings: ExtensionSettings) -> list[Extension]:
    """Return the extensions of other packages that the settings name. Raises ValueError for an unknown name."""
    if taken := [each.name for each in BUILT_IN if each.name in settings.extensions]:
        raise ValueError(f"LINKED_FLEET_EXTENSIONS is of extensions of other packages; {taken[0]} is built in")
    return [_foreign(name) for name in dict.fromkeys(settings.extensions)]


def _foreign(name: str) -> Extension:
    found = entry_points(group=GROUP, name=name)
    if len(found) != 1:
        there = ", ".join(sorted(entry_points(group=GROUP).names)) or "none"
        raise ValueError(
            f"LINKED_FLEET_EXTENSIONS names {name!r}, which {'several' if found else 'no'} installed packages have; "
            f"entry points in the group {GROUP}: {there}"
        )
    (entry_point,) = found
    try:
        kind = entry_point.load()
    except Exception as error:  # whatever its module raises
        raise ValueError(f"LINKED_FLEET_EXTENSIONS names {name!r}, which cannot be imported: {error}") from error
    if not _is_extension(kind) or kind.name != name:
        raise ValueError(
            f"the entry point {name!r} in the group {GROUP} is no extension of that name: {entry_point.value}"
        )
    return kind()


def contributions_of(extensions: Sequence[Extension]) -> Contributions:
    """Return what the extensions add to the tree. Segments of built-in ones are reserved even if these are off."""
    every = {each.name: each for each in (*BUILT_IN, *extensions)}.values()
    return Contributions(
        at_root=CORE_AT_ROOT.union(*(each.at_root for each in every)),
        in_robot=CORE_IN_ROBOT.union(*(each.in_robot for each in every)),
        public=frozenset(segment for each in every for segment in each.public),
        files={
            ACTIONS: _files(each.kinds for each in extensions),
            VOCABULARY: _files(each.vocabulary for each in extensions),
            BLUEPRINTS: _files(each.shapes for each in extensions),
        },
        robot_properties=tuple(one for each in extensions for one in each.robot_properties),
        link_statements=tuple(one for each in extensions for one in each.link_statements),
        introductions=tuple(one for each in extensions for one in each.introductions),
        placements=tuple(one for each in extensions for one in each.placements),
        functions=tuple(one for each in extensions for one in each.functions),
        patches={media_type: read for each in extensions for media_type, read in each.patches.items()},
    )


def _files(files: Iterable[tuple[Path, ...]]) -> tuple[Path, ...]:
    return tuple(chain.from_iterable(files))


def checked_contributions(
    extensions: Sequence[Extension], check_shapes: Callable[[], None]
) -> tuple[Contributions, dict[str, Exception]]:
    """Return the contributions of all extensions that can be used, and the reasons why others cannot, by name.

    ``check_shapes`` raises an error for shapes that cannot be compiled. Those of built-in ones are raised here.
    """
    try:
        return _checked(extensions, check_shapes), {}
    except Exception:
        # Each foreign one is tried alone; if none of them is to blame, the error is of a built-in one.
        own = [each for each in extensions if type(each) in map(type, BUILT_IN)]
        others = [each for each in extensions if each not in own]
        reasons = {each.name: error for each in others if (error := _reason([*own, each], check_shapes)) is not None}
        if not reasons:
            raise
    return _checked([each for each in extensions if each.name not in reasons], check_shapes), reasons


def _checked(extensions: Sequence[Extension], check_shapes: Callable[[], None]) -> Contributions:
    """Return the contributions of extensions. Raises whatever their files and ``check_shapes`` raise."""
    for each in extensions:
        _check_declared(each)
    with using(found := contributions_of(extensions)):
        check_shapes()
    return found


def _reason(extensions: Sequence[Extension], check_shapes: Callable[[], None]) -> Exception | None:
    """Return why these extensions cannot be used together; None if they can."""
    try:
        _checked(extensions, check_shapes)
    except Exception as error:  # noqa: BLE001 - whatever is in the files of one costs this one alone
        return error
    return None


def _check_declared(extension: Extension) -> None:
    """Check what the class of an extension says. Raises ValueError, TypeError with the file or value that is wrong."""
    for file in {*extension.kinds, *extension.vocabulary, *extension.shapes}:
        try:
            load_turtle_file(file)
        except (OSError, SyntaxError, ValueError) as error:
            raise ValueError(f"{file.name}: {error}") from error
    for entry in extension.navigation:
        if not isinstance(entry, NavigationEntry):
            raise TypeError(f"navigation has NavigationEntry objects, not {entry!r:.80}")


def dependency_order(extensions: Sequence[Extension]) -> list[Extension]:
    """Return the extensions in their order, but each after those that it needs or uses.

    Raises ValueError if that is impossible.
    """
    found: dict[str, Extension] = {}
    waiting, on = list(extensions), {each.name for each in extensions}
    while waiting:
        able = next((each for each in waiting if found.keys() >= {*each.needs, *on.intersection(each.uses)}), None)
        if able is None:
            needs = ", ".join(f"{each.name} needs {' and '.join((*each.needs, *each.uses))}" for each in waiting)
            raise ValueError(f"extensions lack others, or need each other: {needs}")
        found[able.name] = able
        waiting.remove(able)
    return list(found.values())


async def mount_extensions(
    extensions: Sequence[Extension],
    core: Core,
    stack: AsyncExitStack,
    left_out: Mapping[str, Exception] | None = None,
) -> dict[str, Mount]:
    """Start the extensions in order and add them to the tree and the guards; ``stack`` ends them.

    Return them by name, without those that fail, which are faults, as are those ``left_out`` before. If one of these
    guards motions, all are refused.
    """
    left_out = left_out or {}
    for extension in BUILT_IN:
        if names := missing_requirements(extension):
            log.warning("The extension %s is off: %s is not installed.", extension.name, " and ".join(names))
    mounts = dict[str, Mount]()
    known_extensions = [each for each in extensions if each.name not in left_out]
    for extension in extensions:
        services = [service for each in mounts.values() for service in each.services]
        known = replace(core, services=services, extensions=known_extensions, extension=extension.name)
        with core.live.faults.guard("extensions", thing=extension.name):
            if extension.name in left_out:
                raise left_out[extension.name]
            mounts[extension.name] = await _mount(extension, known, stack)
            continue
        if extension.guards_motions:
            reason = core.live.faults.find("extensions", thing=extension.name)
            core.actions.guards.add(_MissingGuard(reason))
    for kind in action_definitions():
        if kind.iri not in core.actions.handlers:
            missing = LookupError(f"no Mount.handlers has {kind.iri.value}, so it is refused")
            core.live.faults.note("extensions", missing, thing=f"the action {kind.segment}")
    return mounts


class GuardMissing(MotionRefused):
    """The guard of motions of an extension is missing, because the extension could not be started."""

    status, code, title = 503, "unchecked", "The motion could not be checked"


class _MissingGuard:
    """Refuses all motions in the place of a guard that could not be started."""

    finding_predicate = LF.unknown

    def __init__(self, reason: str) -> None:
        self._reason = reason

    async def wait_until_ready(self, robot: Robot, visible_robots: View) -> None:
        raise self._refusal()

    async def check_path(self, motion: Motion, visible_robots: View, own_id: str) -> bool:
        raise self._refusal()

    def _refusal(self) -> GuardMissing:
        detail = f"Motions are refused, because what checks them is missing: {self._reason}. Restart the gateway."
        return GuardMissing(detail, reason="it could not be checked")


async def _mount(extension: Extension, core: Core, stack: AsyncExitStack) -> Mount:
    """Start one extension. Raises whatever it raises; nothing of it remains then."""
    async with AsyncExitStack() as own:
        found = await own.enter_async_context(extension.start(core))
        if found.guard is not None and not extension.guards_motions:
            raise ValueError(f"the extension {extension.name} has a guard and does not say so in guards_motions")
        stack.push_async_exit(own.pop_all())
    core.live.add_branches(*found.branches)
    core.actions.handlers.update(found.handlers)
    if found.guard is not None:
        core.actions.guards.add(found.guard)
    if found.planner is not None:
        core.actions.guards.planner = found.planner
    return found


def create_representations(mounts: Collection[Mount]) -> Representations:
    """Return the representations of the core and its extensions."""
    html = next((each.html for each in mounts if each.html is not None), None)
    return Representations(html, {name: value for each in mounts for name, value in each.formats.items()})
