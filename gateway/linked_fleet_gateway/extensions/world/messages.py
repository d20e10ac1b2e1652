"""Messages between the gateway and the process that checks motions. Metre, radian; MessagePack."""

from typing import Literal

from msgspec import Struct

from linked_fleet_gateway.extensions.world.scene import Geometry
from linked_fleet_gateway.fleet.model import Pose
from linked_fleet_gateway.fleet.xml import Vector

Positions = dict[str, float]
Kind = Literal["self", "robot", "object"]


class Prepare(Struct, frozen=True, tag="prepare"):
    """Make the shapes of a robot, known by ``key`` from now on. ``meshes``: their file names by URI in the URDF.

    A file name is the digest of a mesh and the suffix of its format. Lacks is answered when the mesh has to be told.
    """

    key: str
    urdf: str
    meshes: dict[str, str]


class PrepareMesh(Struct, frozen=True, tag="mesh"):
    """The content of a mesh, for robots that are prepared after it."""

    name: str
    content: bytes


class PrepareObject(Struct, frozen=True, tag="object"):
    """Make the shape of an object, known by ``key`` from now on."""

    key: str
    geometry: Geometry


class Stood(Struct, frozen=True):
    """The place of something prepared. ``name``: what it is called in an answer; ``base``: its root in the world.

    ``stances``: all the positions of its joints in which it may be met; the first says where all joints are, the others
    where some are besides.
    """

    name: str
    key: str
    base: Pose
    stances: tuple[Positions, ...] = ()


class Leg(Struct, frozen=True):
    """Joints that go together from where they are to ``ends``: straight, or with these velocities at both ends.

    Of a leg with velocities ``duration_s`` is how long it takes.
    """

    ends: Positions
    duration_s: float = 0.0
    enters: Positions = {}
    leaves: Positions = {}


class Way(Struct, frozen=True):
    start: Positions
    legs: tuple[Leg, ...]


class Check(Struct, frozen=True, tag="check"):
    """Question: does a robot meet anything on any of ``ways``? It is now at the start of the first.

    The answer takes at most ``within_s`` of the processor's time.
    """

    robot: Stood
    ways: tuple[Way, ...]
    robots: tuple[Stood, ...]
    objects: tuple[Stood, ...]
    within_s: float


class Ready(Struct, frozen=True, tag="ready"):
    pass


class Lacks(Struct, frozen=True, tag="lacks"):
    """File names of meshes without which a robot cannot be prepared."""

    meshes: tuple[str, ...]


class Free(Struct, frozen=True, tag="free"):
    """``samples``: at how many places of the way the robot was looked at."""

    samples: int


class Meets(Struct, frozen=True, tag="meets"):
    """``link`` meets ``link`` of ``name``, or the object of that name, after ``share`` of the way.

    ``point``: where in the world, None if that is not known.
    """

    link: str
    kind: Kind
    name: str
    other: str
    share: float
    point: Vector | None = None


class Unable(Struct, frozen=True, tag="unable"):
    reason: str


Question = Prepare | PrepareMesh | PrepareObject | Check
Answer = Ready | Lacks | Free | Meets | Unable
