"""The rendered scene of a robot: visual geometry on a floor under a light, seen through its cameras."""

import math
from collections.abc import Mapping
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image

from linked_fleet_agent.robots.camera_client import PictureRequest, Scene
from linked_fleet_agent.robots.urdf_repair import find_mesh, mesh_path, repaired_urdf
from linked_fleet_agent.urdf import RobotModel
from linked_fleet_agent.urdf.geometry import MeshShape, Shape
from linked_fleet_agent.urdf.model import Link
from linked_fleet_agent.urdf.writer import plain_element
from linked_fleet_agent.wire.messages import Camera

_QUALITY, _COMPRESSION = 80, 3
_FLOOR_M, _TILE_M = 20.0, 0.5
# ROS's optical frame looks along z with y down, MuJoCo's camera along -z with y up: a half turn about x, as w x y z.
_HALF_TURN = np.array([0.0, 1.0, 0.0, 0.0])


class CameraScene:
    """The model of one robot and its renderers. Raises ValueError (UrdfError) if no model can be built."""

    def __init__(self, scene: Scene) -> None:
        self._cameras = {camera.name: camera for camera in scene.cameras}
        self._model = _model(scene)
        self._data = mujoco.MjData(self._model)
        self._renderers: dict[tuple[int, int], mujoco.Renderer] = {}
        self._pose(scene.home, None)
        self._lay_floor(scene.floating)

    def take(self, exposure: PictureRequest) -> bytes:
        """Return a JPEG or PNG file, or float32 depths in metre with NaN where nothing is in range."""
        camera = self._cameras[exposure.camera]
        self._pose(exposure.positions, exposure.base)
        renderer = self._renderer(camera)
        if exposure.format == "depth":
            return self._depth(renderer, camera)
        renderer.update_scene(self._data, camera.name)
        to = BytesIO()
        picture = Image.fromarray(renderer.render())
        if exposure.format == "jpeg":
            picture.save(to, "JPEG", quality=_QUALITY)
        else:
            picture.save(to, "PNG", compress_level=_COMPRESSION)
        return to.getvalue()

    def _depth(self, renderer: mujoco.Renderer, camera: Camera) -> bytes:
        renderer.enable_depth_rendering()
        try:
            renderer.update_scene(self._data, camera.name)
            depths = np.array(renderer.render(), dtype="<f4")
        finally:
            renderer.disable_depth_rendering()
        depths[depths >= camera.far_m * (1 - 1e-4)] = np.nan
        return depths.tobytes()

    def _renderer(self, camera: Camera) -> mujoco.Renderer:
        size = (camera.height, camera.width)
        renderer = self._renderers.get(size)
        if renderer is None:
            renderer = self._renderers[size] = mujoco.Renderer(self._model, *size)
            renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False
            renderer.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
        # MuJoCo multiplies these by the extent of the model.
        self._model.vis.map.znear = camera.near_m / self._model.stat.extent
        self._model.vis.map.zfar = camera.far_m / self._model.stat.extent
        return renderer

    def _pose(self, positions: Mapping[str, float], base: tuple[float, ...] | None) -> None:
        for joint, position in positions.items():
            self._data.qpos[self._model.joint(joint).qposadr[0]] = position
        if base is not None:
            self._data.qpos[:3], self._data.qpos[3:7] = base[:3], (base[6], *base[3:6])
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)

    def _lay_floor(self, floating: bool) -> None:
        """Put the floor at world height zero, or below a fixed-base robot that hangs lower."""
        lowest = 0.0 if floating else min(0.0, *(self._lowest(geom) for geom in range(self._model.ngeom)))
        self._model.geom("floor").pos[2] = lowest
        mujoco.mj_kinematics(self._model, self._data)

    def _lowest(self, geom: int) -> float:
        """Return the lowest world height of a geometry's bounding box; 0 for the floor itself."""
        if self._model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
            return 0.0
        centre, half = self._model.geom_aabb[geom, :3], self._model.geom_aabb[geom, 3:]
        up = self._data.geom_xmat[geom].reshape(3, 3)[2]
        return float(self._data.geom_xpos[geom, 2] + up @ centre - np.abs(up) @ half)


def _model(scene: Scene) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(_visible(scene))
    if scene.floating:
        spec.worldbody.first_body().add_freejoint()
    for mesh in spec.meshes:  # thin meshes have almost no volume; masses do not matter here
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    for camera in scene.cameras:
        _mount(spec, camera)
    _add_surroundings(spec)
    spec.visual.global_.offwidth = max(camera.width for camera in scene.cameras)
    spec.visual.global_.offheight = max(camera.height for camera in scene.cameras)
    return spec.compile()


def _mount(spec: mujoco.MjSpec, camera: Camera) -> None:
    x, y, z, w = camera.orientation_xyzw
    turned = np.zeros(4)
    mujoco.mju_mulQuat(turned, np.array([w, x, y, z]), _HALF_TURN)
    spec.body(camera.link).add_camera(
        name=camera.name, pos=camera.position_m, quat=turned, fovy=math.degrees(camera.vertical_fov_rad)
    )


def _add_surroundings(spec: mujoco.MjSpec) -> None:
    """Add a tiled floor, a sky and a light from above."""
    sky = spec.add_texture(
        name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT
    )
    sky.rgb1, sky.rgb2, sky.width, sky.height = [0.62, 0.74, 0.88], [0.94, 0.96, 0.98], 64, 384
    tiles = spec.add_texture(
        name="tiles", type=mujoco.mjtTexture.mjTEXTURE_2D, builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER
    )
    tiles.rgb1, tiles.rgb2, tiles.width, tiles.height = [0.55, 0.57, 0.6], [0.45, 0.47, 0.5], 64, 64
    material = spec.add_material(name="tiles", texuniform=True, texrepeat=[0.5 / _TILE_M, 0.5 / _TILE_M])
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "tiles"
    size = [_FLOOR_M, _FLOOR_M, _TILE_M]
    spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=size, material="tiles")
    spec.worldbody.add_light(
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, dir=[-0.3, 0.4, -0.85], diffuse=[0.6] * 3, castshadow=False
    )
    spec.visual.headlight.ambient, spec.visual.headlight.diffuse = [0.35] * 3, [0.25] * 3


def _visible(scene: Scene) -> str:
    """Return the URDF with only the drawable geometry of each link."""
    model, near = RobotModel.for_urdf(scene.urdf), Path(scene.file)
    links = {name: replace(link, collisions=(), visuals=_drawable(link, near)) for name, link in model.links.items()}
    return repaired_urdf(
        plain_element(replace(model, links=links), lambda uri: mesh_path(uri, near)), scene.robot, scene.floating
    )


def _drawable(link: Link, near: Path) -> tuple[Shape, ...]:
    """Return the visual shapes of a link if MuJoCo can draw all of them, otherwise its collision shapes likewise."""
    for shapes in (link.visuals, link.collisions):
        if shapes and all(_can_draw(shape, near) for shape in shapes):
            return shapes
    return ()


def _can_draw(shape: Shape, near: Path) -> bool:
    return not isinstance(shape.geometry, MeshShape) or find_mesh(shape.geometry.uri, near) is not None
