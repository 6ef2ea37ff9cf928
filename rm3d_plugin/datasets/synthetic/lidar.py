"""A virtual spinning lidar of 64 beams, and the ray casting behind it.

Every beam starts at the origin, so a triangle is drawn into the range image (beam, azimuth) much as a renderer draws it
into pixels: only the beams inside its bounds are tested. No library's rounding enters the result: the hit triangle is
found and the range computed by plain float64 sums, and ties go to the lowest triangle.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from numba import njit

from rm3d_plugin.datasets.synthetic.shapes import Mesh, cos_sin
from rm3d_plugin.datasets.synthetic.texture import noise_field

PATCHES, GRAIN = 0.6, 0.65  # half of the widest swing of the reflectance, as a share of its mean
DARK = 0.04  # strength that reads as zero
FLICKER = 0.035  # deviation of the intensity between two returns of one place
OWN_CAR = (-17.0, -25.0)  # degrees: elevations where the carrying car begins to hide, and where it hides most
EDGE, FAR_EDGE = 0.4, 6.0  # m; smaller steps hide in the noise, over larger ones both surfaces return by themselves


@dataclass(frozen=True)
class SpinningLidar:
    """The sensor; the defaults follow a Velodyne HDL-64E.

    Attributes:
        azimuth_step: Degrees between two firings. Larger: fewer points.
        max_range: Metres.
        range_noise: Standard deviation in metres; 14.5 mm give the roughness of real roads as scanned.
        lost: Share of returns lost at random.
        mixed: Share of the returns at depth edges that lie between the two surfaces, since a beam has a width.
        laser_spread: Half width of the lasers' gains around 1; each laser of a spinning lidar is its own device.
        hidden: Share of the steepest beam's returns that the carrying car hides; none is hidden above -17 degrees.
        tilts: Elevations of the beams in degrees, highest first; empty: the HDL-64E's.
    """

    azimuth_step: float = 0.35
    max_range: float = 80.0
    range_noise: float = 0.0145
    lost: float = 0.04
    mixed: float = 0.25
    laser_spread: float = 0.12
    hidden: float = 0.9
    tilts: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not 0.02 <= self.azimuth_step <= 5:
            raise ValueError(f'azimuth_step: expected 0.02 to 5 degrees, got {self.azimuth_step}')
        if any(a <= b for a, b in zip(self.tilts, self.tilts[1:], strict=False)) or any(
            abs(t) > 85 for t in self.tilts
        ):
            raise ValueError('tilts: expected degrees between 85 and -85, highest first')

    @property
    def elevations(self) -> Float[np.ndarray, ' beams']:
        """Degrees, highest first; the HDL-64E's are a third of a degree apart in the upper half, then half a degree."""
        if self.tilts:
            return np.array(self.tilts)
        return np.concatenate([2.0 - np.arange(32) / 3, -8.83 - np.arange(32) * (15.97 / 31)])

    @property
    def azimuths(self) -> Float[np.ndarray, ' columns']:
        """Degrees from +x, counter-clockwise."""
        return np.arange(int(np.ceil(360.0 / self.azimuth_step - 1e-9))) * self.azimuth_step


class Beams(NamedTuple):
    """Unit directions as tables: direction = (cos e cos a, cos e sin a, sin e)."""

    azimuth: Float[np.ndarray, 'columns 2']
    elevation: Float[np.ndarray, 'beams 2']
    step: float  # radians between two columns


class Hits(NamedTuple):
    """What each beam meets, beam by beam, azimuth by azimuth.

    Attributes:
        triangle: (beams * columns,) int64, -1 where nothing is hit.
        distance: (beams * columns,) float64 metres, infinite where nothing is hit.
    """

    triangle: Int[np.ndarray, ' rays']
    distance: Float[np.ndarray, ' rays']


class Scan(NamedTuple):
    """Returned points.

    Attributes:
        xyz: (N, 3) float64 metres, whole millimetres, sensor frame.
        intensity: (N,) float64 in [0, 1], whole hundredths.
        triangle: (N,) int64 the triangle that each point lies on.
        mixed: (N,) bool, whether it lies between that triangle and what is seen beside it.
    """

    xyz: Float[np.ndarray, 'points 3']
    intensity: Float[np.ndarray, ' points']
    triangle: Int[np.ndarray, ' points']
    mixed: Bool[np.ndarray, ' points']


class Anchor(NamedTuple):
    """Where the sensor stands in the world that its surfaces' textures belong to: metres, and radians about z."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    yaw: float = 0.0


def make_beams(lidar: SpinningLidar) -> Beams:
    """The directions of one turn, rounded to 12 digits."""
    azimuth = np.stack(cos_sin(np.deg2rad(lidar.azimuths)), axis=1)
    elevation = np.stack(cos_sin(np.deg2rad(lidar.elevations)), axis=1)
    return Beams(azimuth, elevation, float(np.deg2rad(lidar.azimuth_step)))


def directions(beams: Beams) -> Float[np.ndarray, 'rays 3']:
    """Unit vectors, beam by beam."""
    cos_e, sin_e = beams.elevation[:, :1], beams.elevation[:, 1:]
    x, y = cos_e * beams.azimuth[:, 0], cos_e * beams.azimuth[:, 1]
    return np.stack([x, y, np.broadcast_to(sin_e, x.shape)], axis=-1).reshape(-1, 3)


def cast(corners: Float[np.ndarray, 'faces 3 3'], beams: Beams, max_range: float = 80.0) -> Hits:
    """The first triangle on each beam within max_range metres; corners in the sensor frame."""
    triangle, _ = _draw(np.ascontiguousarray(corners), beams.azimuth, beams.elevation, beams.step, max_range)
    hit = triangle >= 0
    distance = np.full(len(triangle), np.inf)
    distance[hit] = _plane_distance(corners[triangle[hit]], directions(beams)[hit])
    return Hits(triangle, distance)


def count_hits(corners: Float[np.ndarray, 'faces 3 3'], beams: Beams, max_range: float = 80.0) -> int:
    """How many beams meet a body that stands alone."""
    triangle, _ = _draw(np.ascontiguousarray(corners), beams.azimuth, beams.elevation, beams.step, max_range)
    return int((triangle >= 0).sum())


def scan(
    mesh: Mesh,
    hits: Hits,
    lidar: SpinningLidar,
    rng: np.random.Generator,
    anchor: Anchor = Anchor(),  # noqa: B008
) -> Scan:
    """What returns of one turn: some is lost (glass, grazing, dark and far, by chance), the rest is noisy and rounded.

    Args:
        mesh: The scene in the sensor frame.
        hits: What the beams meet in it.
        lidar: The sensor.
        rng: Source of randomness.
        anchor: Pose of the sensor, which the textures do not follow.
    """
    rays = directions(make_beams(lidar))
    noise, chance, flicker = rng.standard_normal(len(rays)), rng.random((5, len(rays))), rng.standard_normal(len(rays))
    hit = np.flatnonzero(hits.triangle >= 0)
    face, ray, distance, chance = hits.triangle[hit], rays[hit], hits.distance[hit], chance[:, hit]
    cosine = _incidence(mesh.corners[face], ray)
    edge = _edges(hits.distance, lidar)[hit]
    edge = np.where(edge > EDGE + 3.0 * _slant(distance, cosine, lidar), edge, 0.0)
    strength = mesh.reflectance[face] * _texture(ray * distance[:, None], anchor) * _gains(lidar)[_beam(hit, lidar)]
    strength = strength * (0.8 + 0.2 * cosine) * (60.0 / (60.0 + np.maximum(distance - 10.0, 0.0)))
    strength = strength * np.where(edge > 0, 0.45 + 0.55 * chance[4], 1.0)  # what a wide beam leaves on the nearer one
    weak = strength * 30.0 < distance / lidar.max_range * chance[1]
    grazing = cosine < 0.02 + 0.03 * chance[1]
    gone = lidar.lost + (1 - lidar.lost) * _hidden(lidar)[_beam(hit, lidar)]
    kept = ~(weak | grazing | (chance[0] < gone + (1 - gone) * mesh.dropout[face]))
    between = (edge > 0) & (edge < FAR_EDGE) & (chance[2] < lidar.mixed)
    distance = distance + np.where(between, chance[3] * np.where(between, edge, 0.0), 0.0)
    distance = distance + lidar.range_noise * np.round(noise[hit], 9)
    intensity = np.clip(strength - DARK + FLICKER * np.round(flicker[hit], 9), 0.0, 0.99)
    xyz = np.round(ray * distance[:, None], 3)
    return Scan(xyz[kept], np.round(intensity, 2)[kept], face[kept], between[kept])


def _beam(ray: Int[np.ndarray, ' rays'], lidar: SpinningLidar) -> Int[np.ndarray, ' rays']:
    return ray // len(lidar.azimuths)


def _slant(
    distance: Float[np.ndarray, ' rays'], cosine: Float[np.ndarray, ' rays'], lidar: SpinningLidar
) -> Float[np.ndarray, ' rays']:
    """How much further the next column meets a surface only because the surface is slanted, metres."""
    step: Float[np.ndarray, ' rays'] = distance * np.deg2rad(lidar.azimuth_step)
    return step * np.sqrt(1.0 - np.minimum(cosine, 1.0) ** 2) / np.maximum(cosine, 1e-3)


def _gains(lidar: SpinningLidar) -> Float[np.ndarray, ' beams']:
    """Gain of each laser, the same in every scan."""
    number = np.arange(len(lidar.elevations), dtype=np.float64)
    scatter = (number * 0.6180339887) % 1.0  # golden ratio: neighbours differ
    return 1.0 + lidar.laser_spread * (2.0 * scatter - 1.0)


def _hidden(lidar: SpinningLidar) -> Float[np.ndarray, ' beams']:
    """Share of each beam's returns that the carrying car hides."""
    steep = (OWN_CAR[0] - lidar.elevations) / (OWN_CAR[0] - OWN_CAR[1])
    return lidar.hidden * np.clip(steep, 0.0, 1.0)


def _texture(xyz: Float[np.ndarray, 'points 3'], anchor: Anchor) -> Float[np.ndarray, ' points']:
    """Reflectance about its mean: stains and patches of metres, and the grain of a decimetre."""
    c, s = (float(v) for v in cos_sin(anchor.yaw))
    x, y, z = xyz[:, 0], xyz[:, 1], xyz[:, 2]
    world = np.stack([c * x - s * y + anchor.x, s * x + c * y + anchor.y, z + anchor.z], axis=1)
    uneven = PATCHES * (noise_field(world, 1.3) - 0.5) + GRAIN * (noise_field(world, 0.11) - 0.5)
    return np.maximum(1.0 + uneven, 0.02)


def _edges(distance: Float[np.ndarray, ' rays'], lidar: SpinningLidar) -> Float[np.ndarray, ' rays']:
    """How many metres further the next columns see, at most; infinite before the sky, not positive inside surfaces."""
    image = distance.reshape(-1, len(lidar.azimuths))
    with np.errstate(invalid='ignore'):
        beside = np.maximum(np.roll(image, 1, axis=1), np.roll(image, -1, axis=1)) - image
    return np.nan_to_num(beside, nan=0.0, posinf=np.inf).reshape(-1)


def _normals(corners: Float[np.ndarray, 'faces 3 3']) -> Float[np.ndarray, 'faces 3']:
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return np.stack([a[:, i] * b[:, j] - a[:, j] * b[:, i] for i, j in ((1, 2), (2, 0), (0, 1))], axis=1)


def _dot(a: Float[np.ndarray, 'rows 3'], b: Float[np.ndarray, 'rows 3']) -> Float[np.ndarray, ' rows']:
    return a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2]


def _plane_distance(
    corners: Float[np.ndarray, 'faces 3 3'], rays: Float[np.ndarray, 'faces 3']
) -> Float[np.ndarray, ' faces']:
    normal = _normals(corners)
    return _dot(corners[:, 0], normal) / _dot(rays, normal)


def _incidence(
    corners: Float[np.ndarray, 'faces 3 3'], rays: Float[np.ndarray, 'faces 3']
) -> Float[np.ndarray, ' faces']:
    """Cosine between a beam and the normal of the surface, in [0, 1]."""
    normal = _normals(corners)
    return np.abs(_dot(rays, normal)) / np.sqrt(_dot(normal, normal))


@njit(cache=True)
def _draw(corners: Any, azimuth: Any, elevation: Any, step: float, max_range: float) -> Any:
    """Triangle and distance of each beam; a depth buffer over (beam, azimuth)."""
    beams, columns = elevation.shape[0], azimuth.shape[0]
    best = np.full(beams * columns, max_range)
    owner = np.full(beams * columns, -1, dtype=np.int64)
    tangent = elevation[:, 1] / elevation[:, 0]
    for f in range(corners.shape[0]):
        row_from, row_to = _rows(corners[f], tangent)
        if row_from >= row_to:
            continue
        column_from, column_to = _columns(corners[f], step, columns)
        x0, y0, z0 = corners[f, 0, 0], corners[f, 0, 1], corners[f, 0, 2]
        x1, y1, z1 = corners[f, 1, 0], corners[f, 1, 1], corners[f, 1, 2]
        x2, y2, z2 = corners[f, 2, 0], corners[f, 2, 1], corners[f, 2, 2]
        # A beam d passes inside where d . (a x b), d . (b x c) and d . (c x a) have one sign; shared edges give exactly
        # opposite numbers, so nothing slips between two triangles.
        ax, ay, az = y0 * z1 - z0 * y1, z0 * x1 - x0 * z1, x0 * y1 - y0 * x1
        bx, by, bz = y1 * z2 - z1 * y2, z1 * x2 - x1 * z2, x1 * y2 - y1 * x2
        cx, cy, cz = y2 * z0 - z2 * y0, z2 * x0 - x2 * z0, x2 * y0 - y2 * x0
        ux, uy, uz, vx, vy, vz = x1 - x0, y1 - y0, z1 - z0, x2 - x0, y2 - y0, z2 - z0
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        offset = x0 * nx + y0 * ny + z0 * nz
        for column in range(column_from, column_to):
            k = column % columns
            ca, sa = azimuth[k, 0], azimuth[k, 1]
            for row in range(row_from, row_to):
                dx, dy, dz = elevation[row, 0] * ca, elevation[row, 0] * sa, elevation[row, 1]
                a = dx * ax + dy * ay + dz * az
                b = dx * bx + dy * by + dz * bz
                c = dx * cx + dy * cy + dz * cz
                if not ((a >= 0 and b >= 0 and c >= 0) or (a <= 0 and b <= 0 and c <= 0)):
                    continue
                slope = dx * nx + dy * ny + dz * nz
                if slope == 0:
                    continue
                distance = offset / slope
                ray = row * columns + k
                if 0 < distance < best[ray]:
                    best[ray] = distance
                    owner[ray] = f
    return owner, best


@njit(cache=True)
def _rows(corner: Any, tangent: Any) -> Any:
    """Beams that may meet a triangle; conservative. The tangents descend."""
    low, high = min(corner[0, 2], corner[1, 2], corner[2, 2]), max(corner[0, 2], corner[1, 2], corner[2, 2])
    near, far = _plan_distances(corner)
    near = max(near, 1e-6)
    far = max(far, 1e-6)
    top = high / near if high >= 0 else high / far
    bottom = low / far if low >= 0 else low / near
    margin = 1e-6
    return np.searchsorted(-tangent, -top - margin), np.searchsorted(-tangent, -bottom + margin)


@njit(cache=True)
def _plan_distances(corner: Any) -> Any:
    """Least and greatest distance of a triangle from the z axis."""
    inside_left, inside_right = True, True
    near_sq, far_sq = np.inf, 0.0
    for i in range(3):
        x, y = corner[i, 0], corner[i, 1]
        ex, ey = corner[(i + 1) % 3, 0] - x, corner[(i + 1) % 3, 1] - y
        side = ex * -y - ey * -x
        inside_left = inside_left and side >= 0
        inside_right = inside_right and side <= 0
        length_sq = ex * ex + ey * ey
        t = 0.0 if length_sq == 0 else min(max(-(x * ex + y * ey) / length_sq, 0.0), 1.0)
        px, py = x + t * ex, y + t * ey
        near_sq = min(near_sq, px * px + py * py)
        far_sq = max(far_sq, x * x + y * y)
    if inside_left or inside_right:
        near_sq = min(near_sq, 0.0) if not (inside_left and inside_right) else near_sq
    return np.sqrt(near_sq), np.sqrt(far_sq)


@njit(cache=True)
def _columns(corner: Any, step: float, columns: int) -> Any:
    """First column and the one after the last; they may pass the end of the turn, to be taken modulo."""
    first = np.arctan2(corner[0, 1], corner[0, 0])
    low, high = 0.0, 0.0
    for i in range(1, 3):
        turn = np.arctan2(corner[i, 1], corner[i, 0]) - first
        if turn > np.pi:
            turn -= 2 * np.pi
        elif turn < -np.pi:
            turn += 2 * np.pi
        low, high = min(low, turn), max(high, turn)
    if high - low >= np.pi - 1e-9:
        return 0, columns
    start = first + low
    if start < 0:
        start += 2 * np.pi
    begin = int(np.floor(start / step - 1e-6))
    end = int(np.ceil((start + high - low) / step + 1e-6)) + 1
    # Where the last gap of the turn is not a whole step, the columns after the seam lie up to one step further.
    if end > columns:
        end += 1
    if begin < 0:
        begin += columns
        end += columns
    return (0, columns) if end - begin >= columns else (begin, end)
