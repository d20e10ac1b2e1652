"""Components and their invocations at two gateways: both say the same, and what an action returned outlives one."""

import signal
from pathlib import Path
from typing import Any

import httpx
import pytest

from browser import LF
from component_cell import Cell
from running import eventually, process
from small_fleet import Place
from virtual.processes import serving_robot

pytestmark = pytest.mark.virtual
JSON = {"accept": "application/json"}


def get(place: Place, path: str) -> Any:
    answer = httpx.get(place.root + path.lstrip("/"), headers=JSON, timeout=20)
    return answer.json() if answer.status_code == 200 else None


def post(place: Place, action: str, prefer: str) -> httpx.Response:
    return httpx.post(f"{place.root}cell/gripper/actions/{action}", headers={"prefer": prefer}, timeout=20)


def test_results_outlive_the_gateway_that_was_asked(tmp_path: Path) -> None:
    one = Place(tmp_path)
    other, cell = Place(tmp_path, zenoh=one.zenoh), Cell()
    with process(*one.command()) as first, process(*other.command()) as second:
        first.said("serving")
        second.said("serving")
        with serving_robot(one.zenoh, "cell", cell):
            for place in (one, other):
                eventually(lambda: get(place, "cell/gripper") == {"width": 0.08}, "components at both gateways")  # noqa: B023
            waiting = httpx.post(
                one.root + "cell/gripper/actions/wait", headers={"prefer": "respond-async"}, timeout=20
            )
            grasped = httpx.post(one.root + "cell/gripper/actions/grasp", headers={"prefer": "wait=5"}, timeout=20)
            path = httpx.URL(grasped.headers["location"]).path
            first.send(signal.SIGKILL)
            output = {"width": 0.03, "holding": True}
            eventually(lambda: (get(other, path) or {}).get("output") == output, "the result at the other gateway")
            said = get(other, httpx.URL(waiting.headers["location"]).path)
            assert said["state"] == str(LF.preempted)
            third = Place(tmp_path, zenoh=one.zenoh)
            with process(*third.command()) as late:
                late.said("serving")
                eventually(lambda: (get(third, path) or {}).get("output") == output, "the result at a new gateway")
                eventually(lambda: get(third, "cell/gripper") == {"width": 0.03}, "the values at a new gateway")
