"""The world as triples for queries: complete, and stable if nothing has changed."""

from functools import partial
from pathlib import Path
from typing import Any, cast

from pyoxigraph import Literal, NamedNode

from floor_maps import FREE, UNKNOWN, WALL, pgm, yaml
from linked_fleet_gateway.api import Core
from linked_fleet_gateway.app.application import create_live
from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_gateway.extensions.models.meshes import Meshes, ask
from linked_fleet_gateway.extensions.world import floor_map
from linked_fleet_gateway.extensions.world.floor_map import ID
from linked_fleet_gateway.extensions.world.map_image import build_map
from linked_fleet_gateway.extensions.world.map_yaml import read_yaml
from linked_fleet_gateway.extensions.world.placement import LF
from linked_fleet_gateway.extensions.world.scene import SceneObject, Sphere, encode
from linked_fleet_gateway.extensions.world.service import World
from linked_fleet_gateway.resources.access_filter import InvocationsInView
from linked_fleet_gateway.resources.branches import RequestView
from linked_fleet_gateway.serving import Live
from linked_fleet_identity.rights import ALL
from linked_fleet_rdf.vocabulary import DCTERMS, LDP, RDF
from linked_fleet_state.invocations import Invocations
from linked_fleet_state.model import Pose
from virtual.zenoh_network import ZenohNetwork

BASE = "http://fleet.test"


def test_all_that_is_in_the_world_is_told_and_told_anew_when_it_changes(tmp_path: Path) -> None:
    live = create_live(GatewaySettings(), ZenohNetwork().gateway("g"))
    world = world_of(live, tmp_path)
    view = RequestView(BASE, live.fleet.robots, InvocationsInView(Invocations(), ALL), ALL)
    where = Pose((0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0))
    for i in range(150):  # more than one page shows
        ball = SceneObject(title=f"ball {i}", kind="obstacle", pose=where, geometry=Sphere(0.1))
        world.objects._take(f"ball{i}", encode(ball))
    told = dict(world.triples(view))
    assert {triple.subject for triple in told["/world"]} == {NamedNode(BASE + "/world")}
    titles = {t.object for t in told["/world/objects"] if t.predicate == DCTERMS.title}
    assert {Literal(f"ball {i}") for i in range(150)} <= titles
    listed = {t.object for t in told["/world/objects"] if t.predicate == LDP.contains}
    typed = {t.subject for t in told["/world/objects"] if t.predicate == RDF.type and t.object == LF.Obstacle}
    assert listed == typed
    assert dict(world.triples(view))["/world/objects"] is told["/world/objects"]
    world.objects._take("ball0", None)
    assert len(dict(world.triples(view))["/world/objects"]) < len(told["/world/objects"])


async def test_planners_get_the_cells_of_the_present_map(tmp_path: Path) -> None:
    """Unpacked once for each map; without a map there are none."""
    live = create_live(GatewaySettings(), ZenohNetwork().gateway("g"))
    world = world_of(live, tmp_path)
    assert await world.occupancy() is None
    said, _ = read_yaml(yaml(0.5, (1.0, 2.0, 0.0)))
    floor = build_map(said, pgm([[WALL, FREE, UNKNOWN]]), title="hall", height_m=2.0, client="ann")
    world.maps._take(ID, floor_map.encode(floor))
    grid = await world.occupancy()
    assert grid is not None and grid.cells.tolist() == [[100, 0, -1]]
    assert grid.values([(1.2, 2.2), (2.2, 2.2), (9.0, 9.0)]).tolist() == [100, -1, -1]
    assert await world.occupancy() is grid
    world.maps._take(ID, None)
    assert await world.occupancy() is None


def world_of(live: Live, folder: Path) -> World:
    core = Core(*cast(Any, (live, None, None, None, "unix:///nowhere", "fleet", "", (), folder)))
    return World(core, Meshes(partial(ask, live.link)), folder)
