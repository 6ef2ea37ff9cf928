"""Virtual depth cameras in a room: a hand-held walk, or a tripod that turns at a few places.

Each image is a depth buffer over the room's triangles; no library's rounding enters, ties go to the lowest triangle.
What a camera misses stays a hole: behind furniture, at grazing angles, on glass, far away.
"""

from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from numba import njit

from rm3d_plugin.datasets.synthetic.road_users import pick
from rm3d_plugin.datasets.synthetic.room_layout import Layout, Rect
from rm3d_plugin.datasets.synthetic.room_materials import shaded_colors
from rm3d_plugin.datasets.synthetic.shapes import cos_sin
from rm3d_plugin.datasets.synthetic.texture import noise_field

Scanner = Literal['handheld', 'tripod']
HALF_WIDTH, HALF_HEIGHT = 0.62, 0.47  # tangents of half the angles of view: 64 x 50 degrees
WARP_WIDTH = 0.07  # of the image's half width in tangents: 15 cm at a typical distance
AMBIENT, GREY = 0.1, 0.48  # light from everywhere; mean of an image after exposure
OFFSET, BLUR = 1.0, 0.4  # pixels between colour and depth (deviation); share of a pixel's neighbours in its colour
TYPICAL = 2.2  # m; a pixel is as wide there as the fused points are apart


@dataclass(frozen=True)
class DepthCamera:
    """The sensor; the defaults follow a structured-light camera.

    Attributes:
        columns: Pixels across.
        rows: Pixels down.
        near, far: Metres along the view that it can measure.
        noise: Standard deviation of the depth in metres at 1 m; it grows with the square of the depth.
        warp: Half width of the smooth error of the depth in metres; grows with 1.5 + the square of the depth.
        drift: Standard deviation of a pose's error: metres, and radians times 4.
        lost: Share of pixels lost at random.
    """

    columns: int
    rows: int
    near: float = 0.35
    far: float = 4.0
    noise: float = 0.0007
    warp: float = 0.0075
    drift: float = 0.008
    lost: float = 0.03

    @staticmethod
    def for_spacing(spacing: float, scanner: Scanner) -> 'DepthCamera':
        """A camera whose pixels are ``spacing`` metres wide at a typical distance."""
        columns = round(2 * HALF_WIDTH * TYPICAL / spacing)
        rows = round(2 * HALF_HEIGHT * TYPICAL / spacing)
        if scanner == 'handheld':
            return DepthCamera(columns, rows)
        return DepthCamera(columns, rows, far=12.0, noise=0.0005, warp=0.0045)

    def of_quality(self, factor: float) -> 'DepthCamera':
        """The same camera, its errors larger by a factor."""
        return replace(self, noise=factor * self.noise, warp=factor * self.warp, drift=factor * self.drift)

    @property
    def pitch(self) -> float:
        """Width of a pixel at 1 m, metres."""
        return 2 * HALF_WIDTH / self.columns


class View(NamedTuple):
    """A pose of the camera.

    Attributes:
        place: (3,) metres.
        axes: (3, 3) its right, down and forward directions, as rows.
    """

    place: Float[np.ndarray, '3']
    axes: Float[np.ndarray, '3 3']


class Surfaces(NamedTuple):
    """A room's triangles.

    Attributes:
        corners: (F, 3, 3) metres.
        normals: (F, 3) unit normals, either side.
        material: (F,) row of ``materials``.
        thing: (F,) number of the thing.
        materials: (M, 10) rows of ``Material.row``.
    """

    corners: Float[np.ndarray, 'faces 3 3']
    normals: Float[np.ndarray, 'faces 3']
    material: Int[np.ndarray, ' faces']
    thing: Int[np.ndarray, ' faces']
    materials: Float[np.ndarray, 'materials 10']


class Shots(NamedTuple):
    """What all images hold together, image by image, row by row; only pixels that measured something.

    Attributes:
        xyz: (P, 3) metres, room frame.
        colors: (P, 3) in [0, 1].
        normals: (P, 3) of the true surface, facing the camera.
        thing: (P,) number of the thing seen.
        face: (P,) the triangle seen.
        pixel: (P,) position in the stack of images.
        shape: (images, rows, columns).
    """

    xyz: Float[np.ndarray, 'pixels 3']
    colors: Float[np.ndarray, 'pixels 3']
    normals: Float[np.ndarray, 'pixels 3']
    thing: Int[np.ndarray, ' pixels']
    face: Int[np.ndarray, ' pixels']
    pixel: Int[np.ndarray, ' pixels']
    shape: tuple[int, int, int]


def surfaces_of(layout: Layout) -> Surfaces:
    """All triangles of a room; those without area are left out."""
    corners, material, owner = [], [], []
    rows: list[list[float]] = []
    for number, item in enumerate(layout.things):
        for body, skin in item.parts:
            corners.append(body.corners)
            material.append(np.full(len(body), len(rows), dtype=np.int64))
            owner.append(np.full(len(body), number, dtype=np.int64))
            rows.append(skin.row())
    every = np.concatenate(corners)
    a, b = every[:, 1] - every[:, 0], every[:, 2] - every[:, 0]
    normals = np.stack([a[:, i] * b[:, j] - a[:, j] * b[:, i] for i, j in ((1, 2), (2, 0), (0, 1))], axis=1)
    size = np.sqrt(normals[:, 0] ** 2 + normals[:, 1] ** 2 + normals[:, 2] ** 2)
    good = size > 1e-9
    normals = normals[good] / size[good, None]
    return Surfaces(every[good], normals, np.concatenate(material)[good], np.concatenate(owner)[good], np.array(rows))


def view_from(place: tuple[float, float, float], yaw: float, pitch: float) -> View:
    """A camera that looks along yaw, pitched up by an angle (radians)."""
    c, s = (float(v) for v in cos_sin(yaw))
    cp, sp = (float(v) for v in cos_sin(pitch))
    forward, right = (c * cp, s * cp, sp), (s, -c, 0.0)
    down = (c * sp, s * sp, -cp)
    return View(np.array(place), np.array([right, down, forward]))


def plan_views(layout: Layout, scanner: Scanner, rng: np.random.Generator) -> list[View]:
    """Where the camera looks from and to."""
    if scanner == 'tripod':
        return _tripod_views(layout, rng)
    length, width, _ = layout.size
    stops = 2 + int(length * width / 6)
    views = []
    for _ in range(stops):
        x, y = _standing_place(layout, rng)
        # Each stop sweeps a part of the turn only, looking inwards on the whole: corners stay unseen.
        start = np.arctan2(width / 2 - y, length / 2 - x) + pick(rng, -1.4, 1.4)
        for k in range(5):
            yaw = float(np.round(start, 9)) + (k - 2) * pick(rng, 0.35, 0.75)
            pitch = pick(rng, -0.9, -0.1) if rng.random() < 0.92 else pick(rng, -0.1, 0.4)
            views.append(view_from((x, y, pick(rng, 1.25, 1.7)), yaw, pitch))
            x, y = _step(layout, rng, x, y)
    return views


def _tripod_views(layout: Layout, rng: np.random.Generator) -> list[View]:
    length, width, _ = layout.size
    views = []
    for _ in range(1 + int(length * width / 8)):
        x, y = _standing_place(layout, rng)
        first = pick(rng, 0, 1)
        for k in range(6):
            for pitch in (-0.7, 0.0, 0.75):
                views.append(view_from((x, y, 1.5), first + k * np.pi / 3, pitch))
    return views


def _standing_place(layout: Layout, rng: np.random.Generator) -> tuple[float, float]:
    """Somewhere on the free floor; the last try where there is none."""
    length, width, _ = layout.size
    x, y = length / 2, width / 2
    for _ in range(40):
        x, y = pick(rng, 0.3, length - 0.3), pick(rng, 0.3, width - 0.3)
        if layout.free(Rect(x, y, 0.16, 0.16, 0.0)):
            break
    return x, y


def _step(layout: Layout, rng: np.random.Generator, x: float, y: float) -> tuple[float, float]:
    a, b = x + pick(rng, -0.2, 0.2), y + pick(rng, -0.2, 0.2)
    return (a, b) if layout.free(Rect(a, b, 0.16, 0.16, 0.0)) else (x, y)


def shoot(
    layout: Layout, surfaces: Surfaces, views: list[View], camera: DepthCamera, rng: np.random.Generator
) -> Shots:
    """Take all images: depth with noise and holes, colour in the room's light with each image's own exposure."""
    parts = [_one_image(layout, surfaces, view, camera, rng) for view in views]
    size = camera.rows * camera.columns
    pixel = np.concatenate([np.flatnonzero(kept) + k * size for k, (kept, *_) in enumerate(parts)])
    columns = [np.concatenate([part[i] for part in parts]) for i in range(1, 5)]
    xyz, colors, normals, face = columns
    shape = (len(views), camera.rows, camera.columns)
    return Shots(xyz, colors, normals, surfaces.thing[face], face, pixel, shape)


def _one_image(
    layout: Layout, surfaces: Surfaces, view: View, camera: DepthCamera, rng: np.random.Generator
) -> tuple[Bool[np.ndarray, ' rays'], np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Which pixels measured something, and their xyz, colour, normal and triangle."""
    face, depth, rays = render(surfaces.corners, view, camera)
    count = len(face)
    noise, chance = np.round(rng.standard_normal(count), 9), rng.random((2, count))
    errors, gain = np.round(rng.standard_normal(6), 9), 0.82 + 0.36 * rng.random()
    tint, grain = 0.94 + 0.12 * rng.random(3), np.round(rng.standard_normal((count, 3)), 9)
    hit = np.flatnonzero(face >= 0)
    normal, ray = surfaces.normals[face[hit]], rays[hit]
    slope = ray[:, 0] * normal[:, 0] + ray[:, 1] * normal[:, 1] + ray[:, 2] * normal[:, 2]
    stretch = np.sqrt(ray[:, 0] ** 2 + ray[:, 1] ** 2 + ray[:, 2] ** 2)
    cosine, deep = np.abs(slope) / stretch, depth[hit]
    dropout = surfaces.materials[surfaces.material[face[hit]], 9]
    lost = chance[0, hit] < camera.lost + (1 - camera.lost) * dropout
    keep = ~lost & (cosine > 0.08 + 0.14 * chance[1, hit]) & (deep >= camera.near) & (deep <= camera.far)
    hit, normal, ray, deep, slope = hit[keep], normal[keep], ray[keep], deep[keep], slope[keep]
    true = view.place + ray * deep[:, None]
    warp = camera.warp * (1.5 + deep * deep) * _image_noise(camera, errors[0])[hit]
    noisy = deep + warp + camera.noise * noise[hit] * (0.4 + deep * deep)
    xyz = _drifted(view.place + ray * noisy[:, None], view.place, camera.drift * errors)
    facing = normal * np.where(slope > 0, -1.0, 1.0)[:, None]
    lit = shaded_colors(true, facing, surfaces.material[face[hit]], surfaces.materials, layout.lamps, AMBIENT)
    lit = lit * (_exposure(lit, gain) * tint) * _vignette(camera)[hit, None]
    colors = np.clip(_bled(np.clip(lit, 0.0, 1.0), hit, camera, errors[1:3]) + 0.03 * grain[hit], 0.0, 1.0)
    kept = np.zeros(count, dtype=bool)
    kept[hit] = True
    return kept, xyz, colors, facing, face[hit]


def _exposure(lit: Float[np.ndarray, 'pixels 3'], gain: float) -> float:
    """Automatic exposure: the mean of an image is grey, about."""
    mean = float(lit.sum()) / max(lit.size, 1)
    return gain * GREY / max(round(mean, 9), 0.05)


def _vignette(camera: DepthCamera) -> Float[np.ndarray, ' rays']:
    """Lenses darken towards the corners, by the fourth power of the cosine."""
    row, column = np.divmod(np.arange(camera.rows * camera.columns), camera.columns)
    u = (column + 0.5) * camera.pitch - HALF_WIDTH
    v = (row + 0.5) * (2 * HALF_HEIGHT / camera.rows) - HALF_HEIGHT
    falloff: Float[np.ndarray, ' rays'] = 1.0 / (1.0 + u * u + v * v) ** 2
    return falloff


def _bled(
    colors: Float[np.ndarray, 'pixels 3'], hit: Int[np.ndarray, ' pixels'], camera: DepthCamera, error: np.ndarray
) -> Float[np.ndarray, 'pixels 3']:
    """Colours as they fall onto depths: blurred by motion, and beside the edge they belong to.

    The colour camera stands beside the depth camera and is not quite in time with it, so each image is off by up to
    two pixels or so.
    """
    row, column = np.divmod(hit, camera.columns)
    image = np.full((camera.rows * camera.columns, 3), np.nan)
    image[hit] = colors
    total, weight = np.zeros_like(colors), np.zeros(len(hit))
    across, down = (OFFSET * float(e) for e in error)
    for dr in (-1, 0, 1):
        for dc in (-1, 0, 1):
            r = np.clip(np.floor(row + dr + down + 0.5), 0, camera.rows - 1).astype(np.int64)
            c = np.clip(np.floor(column + dc + across + 0.5), 0, camera.columns - 1).astype(np.int64)
            seen = image[r * camera.columns + c]
            share = np.where(np.isfinite(seen[:, 0]), (1.0, BLUR)[abs(dr)] * (1.0, BLUR)[abs(dc)], 0.0)
            total += share[:, None] * np.nan_to_num(seen)
            weight += share
    found = weight > 0
    return np.where(found[:, None], total / np.maximum(weight, 1e-9)[:, None], colors)


def _image_noise(camera: DepthCamera, seed: float) -> Float[np.ndarray, ' rays']:
    """Smooth noise in [-1, 1] over an image, as wide as the speckles that structured light is matched by."""
    row, column = np.divmod(np.arange(camera.rows * camera.columns), camera.columns)
    size = WARP_WIDTH / camera.pitch
    place = np.stack([column / size, row / size, np.full(len(row), 100.0 * np.round(seed, 6))], axis=1)
    return 2.0 * noise_field(place, 1.0) - 1.0


def _drifted(
    xyz: Float[np.ndarray, 'points 3'], place: Float[np.ndarray, '3'], error: Float[np.ndarray, '6']
) -> Float[np.ndarray, 'points 3']:
    """Points as a slightly wrong pose puts them."""
    x, y, z = (xyz[:, i] - place[i] for i in range(3))
    a, b, c = error[3:] / 4
    return xyz + error[:3] + np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=1)


def render(
    corners: Float[np.ndarray, 'faces 3 3'], view: View, camera: DepthCamera
) -> tuple[Int[np.ndarray, ' rays'], Float[np.ndarray, ' rays'], Float[np.ndarray, 'rays 3']]:
    """The nearest triangle of each pixel (-1 = none), its depth, and the pixel's ray of depth 1 in the room frame."""
    u = (np.arange(camera.columns) + 0.5) * camera.pitch - HALF_WIDTH
    v = (np.arange(camera.rows) + 0.5) * (2 * HALF_HEIGHT / camera.rows) - HALF_HEIGHT
    right, down, forward = view.axes
    rays = (u[None, :, None] * right + v[:, None, None] * down + forward).reshape(-1, 3)
    face, depth = _draw(np.ascontiguousarray(corners), view.place, view.axes, u, v)
    return face, depth, rays


@njit(cache=True)
def _draw(corners: Any, place: Any, axes: Any, u: Any, v: Any) -> Any:
    """Depth buffer: the triangle and the depth of each pixel."""
    rows, columns = v.shape[0], u.shape[0]
    owner = np.full(rows * columns, -1, dtype=np.int64)
    best = np.full(rows * columns, np.inf)
    step_u, step_v = u[1] - u[0], v[1] - v[0]
    p = np.empty((3, 3))
    for f in range(corners.shape[0]):
        for i in range(3):
            x, y, z = corners[f, i, 0] - place[0], corners[f, i, 1] - place[1], corners[f, i, 2] - place[2]
            for k in range(3):
                p[i, k] = axes[k, 0] * x + axes[k, 1] * y + axes[k, 2] * z
        seen, u0, u1, v0, v1 = _bounds(p)
        if not seen:
            continue
        c0, c1 = (
            max(0, int(np.ceil((u0 - u[0]) / step_u - 1e-6))),
            min(columns - 1, int(np.floor((u1 - u[0]) / step_u + 1e-6))),
        )
        r0, r1 = (
            max(0, int(np.ceil((v0 - v[0]) / step_v - 1e-6))),
            min(rows - 1, int(np.floor((v1 - v[0]) / step_v + 1e-6))),
        )
        if c0 > c1 or r0 > r1:
            continue
        # A ray d passes inside where d . (a x b), d . (b x c) and d . (c x a) have one sign.
        ax, ay, az = (
            p[0, 1] * p[1, 2] - p[0, 2] * p[1, 1],
            p[0, 2] * p[1, 0] - p[0, 0] * p[1, 2],
            p[0, 0] * p[1, 1] - p[0, 1] * p[1, 0],
        )
        bx, by, bz = (
            p[1, 1] * p[2, 2] - p[1, 2] * p[2, 1],
            p[1, 2] * p[2, 0] - p[1, 0] * p[2, 2],
            p[1, 0] * p[2, 1] - p[1, 1] * p[2, 0],
        )
        cx, cy, cz = (
            p[2, 1] * p[0, 2] - p[2, 2] * p[0, 1],
            p[2, 2] * p[0, 0] - p[2, 0] * p[0, 2],
            p[2, 0] * p[0, 1] - p[2, 1] * p[0, 0],
        )
        nx, ny, nz = ax + bx + cx, ay + by + cy, az + bz + cz
        offset = p[0, 0] * nx + p[0, 1] * ny + p[0, 2] * nz
        for r in range(r0, r1 + 1):
            for c in range(c0, c1 + 1):
                a = u[c] * ax + v[r] * ay + az
                b = u[c] * bx + v[r] * by + bz
                e = u[c] * cx + v[r] * cy + cz
                if not ((a >= 0 and b >= 0 and e >= 0) or (a <= 0 and b <= 0 and e <= 0)):
                    continue
                slope = u[c] * nx + v[r] * ny + nz
                if slope == 0:
                    continue
                depth = offset / slope
                if 0 < depth < best[r * columns + c]:
                    best[r * columns + c] = depth
                    owner[r * columns + c] = f
    return owner, best


@njit(cache=True)
def _bounds(p: Any) -> Any:
    """Whether a triangle lies before the camera, and its least and greatest image coordinates there."""
    near = 1e-3
    u0, u1, v0, v1, seen = np.inf, -np.inf, np.inf, -np.inf, False
    for i in range(3):
        j = (i + 1) % 3
        x, y, z = p[i, 0], p[i, 1], p[i, 2]
        if z >= near:
            seen = True
            u0, u1, v0, v1 = min(u0, x / z), max(u1, x / z), min(v0, y / z), max(v1, y / z)
        if (z >= near) != (p[j, 2] >= near):
            t = (near - z) / (p[j, 2] - z)
            x, y = (x + t * (p[j, 0] - x)) / near, (y + t * (p[j, 1] - y)) / near
            u0, u1, v0, v1 = min(u0, x), max(u1, x), min(v0, y), max(v1, y)
    return seen, u0, u1, v0, v1
