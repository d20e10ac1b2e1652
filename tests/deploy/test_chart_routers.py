"""The router configurations of the chart, run on this machine: one mesh, and a region in its south."""

import contextlib
import json
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from browser import Browser
from certificates import made
from charts import CHART, SETS, named, rendered
from commanding import WRIST, angle, begun, of_joint, put, radian
from running import Process, free_port, process
from small_fleet import live

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
_WIRE = "/etc/linked-fleet/wire/"
_FILES = {"ca.crt": "ca.pem", "tls.crt": "router.pem", "tls.key": "router.key"}


def _configurations(values: Path, *more: str) -> dict[str, str]:
    """Return file names and texts."""
    found: dict[str, str] = named(rendered(values, *more), "ConfigMap", "lf-linked-fleet-routers")["data"]
    return found


@pytest.mark.parametrize("values", SETS, ids=lambda path: path.name.removesuffix("-values.yaml"))
def test_zenoh_reads_them_and_each_pair_of_routers_has_one_link(values: Path, tmp_path: Path) -> None:
    texts = list(_configurations(values).values())
    for text in texts:
        (tmp_path / "router.json5").write_text(text)
        zenoh.Config.from_file(str(tmp_path / "router.json5"))
    inside = [[each for each in json.loads(text)["connect"]["endpoints"] if ".robots.svc:" in each] for text in texts]
    assert [len(each) for each in inside] == list(range(len(texts)))


@contextlib.contextmanager
def _routing(folder: Path, region: str, texts: dict[str, str], north: list[str]) -> Iterator[list[str]]:
    """Run routers with these configurations, at local endpoints and with certificates of ``folder``."""
    endpoints = [f"tls/127.0.0.1:{free_port()}" for _ in texts]
    with contextlib.ExitStack() as open_here:
        for number, text in enumerate(texts.values()):
            for name, ours in _FILES.items():
                text = text.replace(_WIRE + name, str(folder / ours))
            config = json.loads(text)
            above = [each for each in config["connect"]["endpoints"] if ".robots.svc:" not in each]
            config["listen"]["endpoints"] = [endpoints[number]]
            config["connect"]["endpoints"] = endpoints[:number] + (north if above else [])
            path = folder / f"{region}-{number}.json5"
            path.write_text(json.dumps(config))
            router = open_here.enter_context(process("tests/support/zenoh_router.py", str(path)))
            router.said("routing")
        yield endpoints


def _proof(folder: Path, who: str, prefix: str) -> tuple[str, ...]:
    files = {"ca": "ca.pem", "cert": f"{who}.pem", "key": f"{who}.key"}
    return tuple(word for flag, name in files.items() for word in (f"{prefix}{flag}", str(folder / name)))


def _agent(folder: Path, robot: str, endpoint: str) -> contextlib.AbstractContextManager[Process]:
    proof = _proof(folder, f"agents/{robot}", "--")
    return process("-m", "linked_fleet_agent", f"--robot={robot}=ur5", "--connect", endpoint, *proof)


def test_robots_behind_any_router_and_in_the_south_are_one_fleet(tmp_path: Path) -> None:
    """``near`` is at a router of the plant, ``far`` at one of a hall; a gateway of the plant moves both."""
    made(tmp_path, "--agent", "near,far")
    access = ("--set-file", f"zenoh.accessControl={tmp_path / 'access.json'}")
    plant = _configurations(CHART / "ci" / "production-values.yaml", *access)
    hall = _configurations(CHART / "ci" / "external-redis-values.yaml", "--set", "zenoh.replicas=2", *access)
    port = free_port()
    with (
        _routing(tmp_path, "plant", plant, []) as routers,
        _routing(tmp_path, "hall", hall, routers[:1]) as south,
        _agent(tmp_path, "near", routers[2]),
        _agent(tmp_path, "far", south[1]),
        process(
            "-m", "linked_fleet_gateway", "--port", str(port), "--state-dir", str(tmp_path / "state"),
            "--zenoh-connect", ",".join(routers), *_proof(tmp_path, "gateway", "--zenoh-"),
        ) as gateway,
        contextlib.closing(Browser(f"http://127.0.0.1:{port}/")) as browser,
    ):  # fmt: skip
        gateway.said("serving")
        for robot in ("near", "far"):
            live(browser, robot)
            begun(put(browser, of_joint(browser, WRIST, robot=robot), radian(0.3), prefer="wait=30"))
            assert angle(browser, WRIST, robot) == pytest.approx(0.3, abs=0.01)
