"""The extension ``faults``: the container of all faults, their sources, and what people do with them."""

import asyncio
import logging
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import ClassVar

import msgspec
from prometheus_client.metrics_core import Metric
from pyoxigraph import Triple

from linked_fleet_base.errors import InsufficientScope
from linked_fleet_base.settings import FILE, Section, choice, setting, whole_number
from linked_fleet_gateway.api import (
    ActionRequest,
    Body,
    Call,
    Container,
    Core,
    Extension,
    FleetBranch,
    Graph,
    Member,
    Mount,
    NamedNode,
    NavigationEntry,
    Operation,
    RequestView,
    Right,
    Table,
    UnprocessableContent,
    cancel_tasks,
    counter,
    gauges,
    supervised,
)
from linked_fleet_gateway.extensions.faults.describing import describe, fault_json
from linked_fleet_gateway.extensions.faults.fault import SEVERITIES, Fault, Severity, acknowledge, clear
from linked_fleet_gateway.extensions.faults.gateways import Gateways
from linked_fleet_gateway.extensions.faults.kinds import policy_of
from linked_fleet_gateway.extensions.faults.ledger import ROUND_S, Change, Ledger
from linked_fleet_gateway.extensions.faults.links import Linking
from linked_fleet_gateway.extensions.faults.messages import Telling
from linked_fleet_gateway.extensions.faults.notify import LOOK_S, Notifier, by_apprise
from linked_fleet_gateway.extensions.faults.of_robots import faults_of_robots, introduction
from linked_fleet_gateway.extensions.faults.raising import raise_fault
from linked_fleet_gateway.extensions.faults.recording import Recording
from linked_fleet_gateway.extensions.faults.signals import Signals
from linked_fleet_gateway.extensions.faults.terms import LF
from linked_fleet_gateway.extensions.faults.watch import AboutRun, Watch
from linked_fleet_gateway.extensions.missions.extension import RunsOfMissions
from linked_fleet_gateway.extensions.recordings.recorder import Recorder
from linked_fleet_gateway.faces import Identity, View

log = logging.getLogger(__name__)
HERE = Path(__file__).parent


@dataclass(frozen=True)
class FaultSettings(Section):
    prefix: ClassVar[str] = "LINKED_FLEET_FAULTS_"

    most: int = setting(whole_number(10, 10_000), "2000", "faults of the fleet, cleared ones included")
    kept_days: int = setting(whole_number(0, 3650), "7", "days for which cleared faults are kept")
    notify_file: Path | None = setting(
        FILE, "", "file with addresses of mail and chat, as the package apprise has them, which are told of faults"
    )
    notify_from: str = setting(choice(*SEVERITIES), "error", "the least severity of which these are told")
    notify_again_h: int = setting(whole_number(1, 720), "12", "hours between two messages about a fault")


@dataclass(frozen=True)
class KnownFaults:
    """The faults, for other extensions."""

    known: Mapping[str, Fault]

    def seen_by(self, sees: View) -> list[tuple[str, Fault]]:
        """Return the faults of which those who see these robots may know, by id."""
        return [(id, each) for id, each in self.known.items() if is_visible(each, sees)]


def is_visible(fault: Fault, sees: View) -> bool:
    """Return True if those who see these robots may know of a fault."""
    return all(map(sees.includes, fault.trouble.robots))


class FaultsExtension(Extension):
    """Faults at ``/faults``."""

    name = "faults"
    at_root = ("faults",)
    uses = ("components", "missions", "recordings")
    vocabulary = (HERE / "vocabulary.ttl",)
    shapes = (HERE / "shapes.ttl",)
    kinds = (HERE / "kinds.ttl",)
    settings = FaultSettings
    navigation = (NavigationEntry("Faults", "/faults", 5),)
    introductions = (introduction,)

    def views(self) -> Sequence[object]:
        from linked_fleet_gateway.extensions.faults import page

        return page.VIEWS

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        section = core.section(FaultSettings)
        signals = Signals(policy_of)
        make = partial(_container, Linking(core))
        of_robots = faults_of_robots()
        watch = Watch(core, signals, _about_run(core))
        async with (
            Gateways(core) as gateways,
            core.open_container("faults", Fault, make, section.most) as faults,
        ):
            records = faults.records
            assert isinstance(records, Table)
            ledger = Ledger(
                records, signals, lambda: gateways.leads, watch.judges, section.kept_days * 86_400, section.most
            )

            recorder = core.optional_service(Recorder)
            recording = None if recorder is None else Recording(recorder, ledger.known)

            async def look() -> None:
                await watch.look()
                await ledger.round()
                if of_robots.renew(ledger.known.values()):
                    core.mark_changed("/")
                if recording is not None:
                    recording.look()

            tasks = [supervised(look, "faults", log, "faults are not recorded", ROUND_S)]
            notifier = await _notifier(core, section, ledger, gateways)
            if notifier is not None:
                tasks.append(supervised(notifier.look, "messages", log, "messages about faults are not sent", LOOK_S))
            core.live.add_value_listener(watch.hear_values)
            try:
                with (
                    core.listening_to_invocations(watch.hear_invocation),
                    core.listening_to_descriptions(watch.hear_values, watch.forget),
                ):
                    yield Mount(
                        branches=(_branch(faults),),
                        handlers=_handlers(core, ledger),
                        metrics=lambda: _metrics(ledger, signals, notifier),
                        services=(KnownFaults(records.known),),
                    )
            finally:
                core.live.remove_value_listener(watch.hear_values)
                await cancel_tasks(tasks)


async def _notifier(core: Core, section: FaultSettings, ledger: Ledger, gateways: Gateways) -> Notifier | None:
    """Return what sends messages; None without addresses, and if these cannot be used, which is a fault here."""
    if section.notify_file is None:
        return None
    try:
        send = await asyncio.to_thread(by_apprise, section.notify_file)
    except (OSError, ValueError, ImportError) as error:
        core.faults.note("faults", error, thing="messages")
        return None
    least = next(each for each in SEVERITIES if each == section.notify_from)
    telling = Telling(least, section.notify_again_h * 3600.0, core.public_urls[0])
    return Notifier(telling, send, lambda: gateways.leads, ledger.known, ledger.change)


def _about_run(core: Core) -> AboutRun:
    runs = core.optional_service(RunsOfMissions)
    return (lambda id: None) if runs is None else runs.about


# -- the container ----------------------------------------------------------------------------------------------------


def _container(linking: Linking, table: Table[Fault]) -> Container[Fault]:
    def read(body: Body) -> Fault:
        raise UnprocessableContent("Faults are not written.")

    def describe_one(graph: Graph, member: Member[Fault]) -> None:
        describe(graph, member, linking.of(member))

    return Container(
        segment="faults", title="Faults", type=LF.FaultList, member_type=LF.Fault, records=table,
        shape=LF.FaultShape, read=read, describe=describe_one, facts=linking.of,
        title_of=lambda fault: fault.trouble.says, json=lambda member: fault_json(member, linking.of(member)),
        predicate=LF.faults, visible=is_visible, blueprint=LF.FaultListShape,
        member_blueprint=LF.FaultShape, writing=(Right.ADMIN,), by_clients=False,
    )  # fmt: skip


def _branch(faults: Container[Fault]) -> FleetBranch:
    """Return the branch of the container, with the faults that a caller may see in its queries."""
    branch = faults.branch

    def graphs(view: RequestView) -> Iterator[tuple[str, Sequence[Triple]]]:
        whole = branch.resolve(view, [])
        assert whole is not None and not isinstance(whole, str)
        yield faults.path, whole.full_graph(view.base).triples  # type: ignore[union-attr]

    return replace(branch, graphs=graphs)


# -- what people do ---------------------------------------------------------------------------------------------------


def _handlers(core: Core, ledger: Ledger) -> Mapping[NamedNode, Callable[[ActionRequest], Operation]]:
    def changing(right: Right, change: Callable[[ActionRequest, Call], Change]) -> Callable[[ActionRequest], Operation]:
        def handle(request: ActionRequest) -> Operation:
            async def run(call: Call) -> None:
                def checked(fault: Fault) -> Fault:
                    _check_rights(fault, right, call.caller.identity)
                    return change(request, call)(fault)

                await ledger.change(request.member_id, checked)
                call.accept()

            fault = ledger.known.get(request.member_id)
            return Operation(run, about=() if fault is None else fault.trouble.robots)

        return handle

    return {
        LF.AcknowledgeFault: changing(Right.ACT, lambda request, call: partial(_acknowledged, call)),
        LF.RemarkFault: changing(Right.ACT, _remarking),
        LF.ClearFault: changing(Right.RESET, lambda request, call: partial(_cleared, call)),
        LF.RaiseFault: partial(raise_fault, core, ledger),
    }


def _check_rights(fault: Fault, right: Right, caller: Identity) -> None:
    """Raise InsufficientScope if a caller lacks a right on a robot of a fault."""
    if missing := [each for each in fault.trouble.robots if not caller.has_right(right, each)]:
        names = ", ".join(missing)[:200]
        raise InsufficientScope(f"The fault is about {names}; this takes the right to {right} there.", scope=right)


def _acknowledged(call: Call, fault: Fault) -> Fault:
    return acknowledge(fault, call.client, time.time_ns())


def _remarking(request: ActionRequest, call: Call) -> Change:
    said = request.body.text(request.body.root, LF.remark) or ""
    return lambda fault: msgspec.structs.replace(fault, remark=said)


def _cleared(call: Call, fault: Fault) -> Fault:
    return clear(fault, call.client, time.time_ns())


# -- metrics ----------------------------------------------------------------------------------------------------------


def _metrics(ledger: Ledger, signals: Signals, notifier: Notifier | None) -> Iterator[Metric]:
    opened = [each for each in list(ledger.known.values()) if each.is_open]
    of_all = Counter(each.trouble.severity for each in opened)
    unseen = Counter(each.trouble.severity for each in opened if each.needs_attention)
    yield gauges("open_faults", "Faults that are not cleared.", "severity", _of_each(of_all))
    yield gauges("unacknowledged_faults", "Confirmed faults that nobody acknowledged.", "severity", _of_each(unseen))
    yield counter("faults_left_out", "Faults that this gateway could not record.", ledger.full + signals.left_out)
    sent, failed = (0, 0) if notifier is None else (notifier.sent, notifier.failed)
    yield counter("fault_messages", "Messages about faults that this gateway has sent.", sent)
    yield counter("fault_message_failures", "Messages about faults that could not be sent.", failed)


def _of_each(counts: Mapping[Severity, int]) -> list[tuple[str, float]]:
    return [(each, counts.get(each, 0)) for each in SEVERITIES]
