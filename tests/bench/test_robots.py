"""The benchmark of many robots runs with a few; its speed is not tested."""

import pytest

from bench.crowd import Size
from bench.robots import measure, table

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
FEW = Size(robots=12, joints=3, seconds=0.5, requests=8, rates_hz=(20,))


@pytest.mark.parametrize("gateways", [1, 2])
def test_the_bench_measures_a_few_robots(gateways: int) -> None:
    figures = measure(FEW, gateways)
    assert float(figures["— descriptions asked for, a robot and gateway"]) >= 1
    assert float(figures["20 Hz: frames sent, 1/s"]) > 0
    assert all(figure not in ("", "–") for figure in figures.values())
    assert len(table({"few": figures}).splitlines()) == 2 + len(figures)
