"""Scans of synthetic streets with what each point lies on: what the segmentation writers turn into native files."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.datasets.synthetic.lidar import Anchor, SpinningLidar, cast, make_beams, scan
from rm3d_plugin.datasets.synthetic.parts import Part
from rm3d_plugin.datasets.synthetic.road_users import RoadUser
from rm3d_plugin.datasets.synthetic.shapes import Mesh, cos_sin, join
from rm3d_plugin.datasets.synthetic.street_extras import add_extras
from rm3d_plugin.datasets.synthetic.street_ground import PARKING, SENSOR_HEIGHT, Road
from rm3d_plugin.datasets.synthetic.streets import make_street

STREETS_VERSION = 2  # raise whenever the bytes of a scan change
VAL_STREETS = 1_000_000  # number of the first street that is not for training
_KINDS = {
    'Car': Part.CAR,
    'Van': Part.VAN,
    'Pedestrian': Part.PERSON,
    'Person_sitting': Part.PERSON,
    'Cyclist': Part.BICYCLIST,
}


class Scene(NamedTuple):
    """A street ready to be scanned.

    Attributes:
        mesh: Everything, in the frame of a sensor at the start.
        owner: (F,) the thing that each triangle belongs to, from 0; the last one is the ground.
        road: The ground's shape.
    """

    mesh: Mesh
    owner: Int[np.ndarray, ' faces']
    road: Road


class LabelledScan(NamedTuple):
    """Points of one turn.

    Attributes:
        xyz: (N, 3) float64 metres, whole millimetres, sensor frame.
        intensity: (N,) float64 in [0, 1], whole hundredths.
        part: (N,) int64 :class:`Part` of each point.
        thing: (N,) int64 the thing that it lies on; the same numbers in every scan of a street.
        mixed: (N,) bool, whether it lies between two things.
    """

    xyz: Float[np.ndarray, 'points 3']
    intensity: Float[np.ndarray, ' points']
    part: Int[np.ndarray, ' points']
    thing: Int[np.ndarray, ' points']
    mixed: Bool[np.ndarray, ' points']


class Pose(NamedTuple):
    """Where the sensor stands in the street: metres, and radians counter-clockwise from +x."""

    position: Float[np.ndarray, '3']
    yaw: float

    @property
    def matrix(self) -> Float[np.ndarray, '4 4']:
        """Street from sensor."""
        c, s = (float(v) for v in cos_sin(self.yaw))
        matrix = np.eye(4)
        matrix[:2, :2] = [[c, -s], [s, c]]
        matrix[:3, 3] = self.position
        return matrix


def generator(*numbers: int) -> np.random.Generator:
    """Randomness that depends on nothing but the numbers."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(numbers)))


def make_scene(seed: int, number: int) -> Scene:
    """A street with everything in it; depends on nothing but the arguments."""

    def stay(_: RoadUser, x: float, y: float, z: float, yaw: float) -> tuple[Float[np.ndarray, '3'], float]:
        return np.round(np.array([x, y, z]), 6), yaw

    street = make_street(generator(seed, number), stay)
    ground = street.background.pop()
    add_extras(street, generator(seed, number, 1))
    users = [placed.mesh.named(_KINDS[placed.user.type]) for placed in street.placed]
    meshes = [*users, *street.background, ground]
    owner = np.repeat(np.arange(len(meshes)), [len(mesh) for mesh in meshes])
    return Scene(join(meshes), owner, street.road)


def pose_on_road(road: Road, x: float, offset: float = 0.0) -> Pose:
    """The sensor on its mast, ``x`` metres along the road and ``offset`` to the left of its path."""
    px, py = road.point(x, offset)
    height = float(road.height(x, offset)) + SENSOR_HEIGHT
    return Pose(np.round(np.array([px, py, height]), 6), road.heading(x))


def seen_from(mesh: Mesh, pose: Pose) -> Mesh:
    """A street's mesh in the frame of a sensor in it."""
    c, s = (float(v) for v in cos_sin(pose.yaw))
    x, y, z = (float(v) for v in pose.position)
    return mesh.moved((-c * x - s * y, s * x - c * y, -z), -pose.yaw)


def scan_scene(scene: Scene, pose: Pose, lidar: SpinningLidar, rng: np.random.Generator) -> LabelledScan:
    """One turn of the sensor."""
    c, s = (float(v) for v in cos_sin(pose.yaw))
    x, y, z = (float(v) for v in pose.position)
    mesh = seen_from(scene.mesh, pose)
    returned = scan(mesh, cast(mesh.corners, make_beams(lidar), lidar.max_range), lidar, rng, Anchor(x, y, z, pose.yaw))
    part = mesh.part[returned.triangle]
    px, py = returned.xyz[:, 0], returned.xyz[:, 1]
    street_x, street_y = c * px - s * py + x, s * px + c * py + y
    offset = street_y - scene.road.bend * street_x * street_x
    parking = (part == Part.ROAD) & _on_parking(scene.road, offset)
    return LabelledScan(
        returned.xyz,
        returned.intensity,
        np.where(parking, int(Part.PARKING), part),
        scene.owner[returned.triangle],
        returned.mixed,
    )


def _on_parking(road: Road, offset: Float[np.ndarray, ' points']) -> np.ndarray:
    left = (offset > road.left - PARKING) & road.parked_left
    right = (offset < road.right + PARKING) & road.parked_right
    return left | right


def check_counts(**counts: int) -> None:
    """Raise where a number of frames is out of range.

    Raises:
        ValueError: It names them.
    """
    if min(counts.values()) < 0 or sum(counts.values()) == 0:
        raise ValueError(f'expected frames, got {", ".join(f"{name}={value}" for name, value in counts.items())}')
