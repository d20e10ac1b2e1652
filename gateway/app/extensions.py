"""Extensions found, put in order, and mounted."""

from collections.abc import Sequence
from contextlib import AsyncExitStack
from dataclasses import replace

from gateway.extensions.cameras.extension import CamerasExtension
from gateway.extensions.history.extension import HistoryExtension
from gateway.extensions.pages.extension import PagesExtension
from gateway.extensions.query.extension import QueryExtension
from gateway.extensions.reach.extension import ReachExtension
from gateway.extensions.rules.extension import RulesExtension
from gateway.extensions.sessions.extension import SessionsExtension
from gateway.extensions.things.extension import ThingsExtension
from gateway.extensions.world.extension import WorldExtension
from gateway.http.extension import Core, Extension, Mount
from gateway.http.representation import Representations
from gateway.resources.action_definition import add_kinds
from gateway.resources.fleet_functions import add_functions
from gateway.resources.paths import reserve

BUILT_IN: Sequence[Extension] = (
    ThingsExtension(),
    HistoryExtension(),
    WorldExtension(),
    CamerasExtension(),
    ReachExtension(),
    QueryExtension(),
    RulesExtension(),
    PagesExtension(),
    SessionsExtension(),
)


def install(extensions: Sequence[Extension]) -> None:
    """Have this process know the segments, the kinds of actions and the functions of the extensions."""
    for extension in (*BUILT_IN, *extensions):
        reserve(extension.at_root, extension.in_robot)
    add_kinds(kind for extension in extensions for kind in extension.kinds)
    add_functions(function for extension in extensions for function in extension.functions)


def in_order(extensions: Sequence[Extension]) -> list[Extension]:
    """The extensions, each after those that it needs. ValueError for one whose needs cannot be met."""
    found: dict[str, Extension] = {}
    waiting = list(extensions)
    while waiting:
        able = [each for each in waiting if all(name in found for name in each.needs)]
        if not able:
            lacking = ", ".join(f"{each.name} needs {' and '.join(each.needs)}" for each in waiting)
            raise ValueError(f"extensions lack others, or need each other: {lacking}")
        found |= {each.name: each for each in able}
        waiting = [each for each in waiting if each not in able]
    return list(found.values())


async def mount(extensions: Sequence[Extension], core: Core, stack: AsyncExitStack) -> list[Mount]:
    """Start the extensions one after the other and add them to the tree and to the guards; ``stack`` ends them."""
    mounts: list[Mount] = []
    views = [view for each in extensions for view in each.views]
    for extension in extensions:
        services = [service for each in mounts for service in each.services]
        found = await stack.enter_async_context(extension.start(replace(core, services=services, views=views)))
        core.live.add(*found.branches)
        core.actions.handlers.update(found.handlers)
        if found.guard is not None:
            core.actions.add_guard(found.guard)
        mounts.append(found)
    return mounts


def representations(mounts: Sequence[Mount]) -> Representations:
    """All that the core and its extensions can write."""
    html = next((each.html for each in mounts if each.html is not None), None)
    return Representations(html, {name: value for each in mounts for name, value in each.formats.items()})
