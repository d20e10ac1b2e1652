"""A robot charges by itself: below 20 % a rule runs a mission, which docks the robot and lets it go at 80 %.

Usage: python charge.py http://127.0.0.1:8000/ [below [until]]

Both are kept by the fleet, and work without this program. The rule has the rights of who runs it. A stop of the robot,
by anybody, disables the rule.
"""

import sys
from typing import Any

from rdflib import Graph

from linked_fleet_client.fleet import Collection, Fleet, Thing

METRE = "http://qudt.org/vocab/unit/M"
HOME = {"x": 0.0, "y": -2.4, "unit": METRE}
"""From where the robot sees its station."""
HOURS = 4
PREFIXES = """PREFIX lf: <https://w3id.org/linked-fleet#> PREFIX vom: <http://vocab.arvida.de/2015/06/vom/vocab#>
"""


def level(battery: Thing, comparison: str) -> str:
    """Return a query with an answer while the charge in per cent is so."""
    charge = battery.properties["charge"].iri
    return PREFIXES + (
        f"SELECT ?battery {{ BIND(<{battery.iri}> AS ?battery) <{charge}> lf:value/vom:numericalValue ?percent . "
        f"FILTER(?percent {comparison}) }}"
    )


def invoke(thing: Thing, action: str, **body: Any) -> dict[str, Any]:
    return {"type": "invoke", "action": str(thing.actions[action].iri), "title": action, "body": body}


def charging(robot: Thing, until: float) -> dict[str, Any]:
    base = robot["mobile_base"]
    wait = {"type": "wait", "condition": level(robot["battery"], f">= {until}"), "within": HOURS * 3600.0}
    undock = {"type": "invoke", "action": str(base.actions["undock"].iri), "title": "undock"}
    steps = [invoke(robot, "driveTo", position=HOME), invoke(base, "dock"), {**wait, "title": "charge"}, undock]
    return {"title": f"{robot.name} charges", "step": {"type": "sequence", "steps": steps}}


def rule(robot: Thing, below: float, action: str) -> Graph:
    return Graph().parse(
        format="turtle",
        data=f'''@prefix lf: <https://w3id.org/linked-fleet#> . @prefix dcterms: <http://purl.org/dc/terms/> .
        [] a lf:Rule ; dcterms:title "{robot.name} charges below {below:g} %" ; lf:invokes <{action}> ;
            lf:condition """{level(robot["battery"], f"< {below}")}""" .''',
    )


def main(url: str, below: float = 20, until: float = 80) -> int:
    with Fleet(url) as fleet:
        robot, rules = fleet["tiago"], fleet["rules"]
        assert isinstance(rules, Collection)
        mission = fleet.missions.write(charging(robot, until))
        written = rules.add(rule(robot, below, str(mission.actions["run"].iri)))
        print(f"{written.iri} runs {mission.iri}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], *map(float, sys.argv[2:])))
