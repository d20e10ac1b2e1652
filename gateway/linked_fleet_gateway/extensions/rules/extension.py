"""The extension ``rules``: invoke an action when a pattern over the live fleet starts to hold."""

from collections import Counter
from collections.abc import AsyncIterator, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

from prometheus_client.metrics_core import Metric

from linked_fleet_base.settings import Section, setting, whole_number
from linked_fleet_gateway.api import Core, Extension, Mount, NavigationEntry, RequestView, counter, gauges
from linked_fleet_gateway.extensions.query.service import Queries
from linked_fleet_gateway.extensions.rules.description import ChangeRule, MakeRule, branch, rule_state
from linked_fleet_gateway.extensions.rules.http import change_rule, post_rule
from linked_fleet_gateway.extensions.rules.operations import operations
from linked_fleet_gateway.extensions.rules.request import RULE_SHAPE
from linked_fleet_gateway.extensions.rules.rule_invocation import creator_of
from linked_fleet_gateway.extensions.rules.service import Rules
from linked_fleet_gateway.extensions.rules.store import RuleStore


@dataclass(frozen=True)
class RuleSettings(Section):
    prefix: ClassVar[str] = "LINKED_FLEET_RULES_"

    per_client: int = setting(whole_number(), "50", "rules of one client")


_CLIENT = "the rules"
"""Client of the queries of rules, so that no queries of others count for it."""


class RulesExtension(Extension):
    name = "rules"
    vocabulary = (Path(__file__).with_name("vocabulary.ttl"), RULE_SHAPE)
    shapes = (Path(__file__).with_name("shapes.ttl"),)
    at_root = ("rules",)
    needs = ("query",)
    settings = RuleSettings
    navigation = (NavigationEntry("Rules", "/rules", 20),)

    def views(self) -> Sequence[object]:
        from linked_fleet_gateway.extensions.rules import page

        return (page.RULES, page.RULE, page.FIRINGS)

    def operations(self, view: RequestView) -> Mapping[str, Mapping[str, Any]]:
        return operations(view)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        queries = core.service(Queries)
        rules = Rules(
            core,
            RuleStore(core.redis_url, core.namespace, core.run),
            partial(queries.select, client=_CLIENT),
            queries.check,
            lambda rule: creator_of(rule, core.identities),
            core.section(RuleSettings).per_client,
        )
        with core.listening_to_stops(rules.note_stop):
            async with rules:
                yield Mount(
                    branches=(branch(rules.known),),
                    writers={MakeRule: partial(post_rule, rules), ChangeRule: partial(change_rule, rules)},
                    metrics=lambda: _metrics(rules),
                    services=(rules,),
                )


def _metrics(rules: Rules) -> Iterator[Metric]:
    states = Counter(rule_state(known).value.rpartition("#")[2] for known in list(rules.known.values()))
    yield gauges("rules", "Rules by state.", "state", states.items())
    costly = "Rules disabled here because their conditions were too costly."
    yield counter("rules_too_costly", costly, rules.too_costly)
    yield counter("rule_loops", "Rules disabled here because they fired because of themselves.", rules.loops)
