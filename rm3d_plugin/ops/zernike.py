"""Silhouettes and their moments: what the light field descriptor is made of (Chen et al. 2003; METHOD 3)."""

from math import factorial
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float
from numba import njit

ORDERS = [(n, m) for n in range(1, 11) for m in range(n % 2, n + 1, 2)]  # 35; (0, 0) is 1 for every silhouette
FOURIER = 10  # coefficients kept
SECTORS = 32  # directions in which the outline is sampled
FEATURES = len(ORDERS) + FOURIER


class Views(NamedTuple):
    """Directions from which silhouettes are taken.

    Attributes:
        axes: (10, 3) one of each pair of opposite vertices of a dodecahedron, unit.
        rights: (10, 3) first axis of each image.
        ups: (10, 3) second axis of each image.
    """

    axes: Float[np.ndarray, '10 3']
    rights: Float[np.ndarray, '10 3']
    ups: Float[np.ndarray, '10 3']


def dodecahedron_views() -> Views:
    """The ten directions, in a fixed order."""
    golden = (1 + np.sqrt(5)) / 2
    signs = [(a, b) for a in (1.0, -1.0) for b in (1.0, -1.0)]
    corners = [(a, b, c) for a in (1.0, -1.0) for b, c in signs]
    for a, b in signs:
        corners += [(0, a / golden, b * golden), (a / golden, b * golden, 0), (a * golden, 0, b / golden)]
    vertices = np.array(corners) / np.sqrt(3)
    positive = [v for v in vertices if tuple(v.round(9)) > tuple((-v).round(9))]
    axes = np.array(sorted(positive, key=lambda v: tuple(v.round(9))))
    rights = np.cross(axes, np.array([0.2, 0.3, 1.0]))  # any will do: the features ignore rotations of the image
    rights /= np.linalg.norm(rights, axis=1, keepdims=True)
    return Views(axes, rights, np.cross(axes, rights))


def zernike_basis(resolution: int) -> Complex[np.ndarray, 'rows columns 35']:
    """Conjugate Zernike polynomials at the pixels of a square image; zero outside the unit disc.

    Args:
        resolution: Pixels along an edge.
    """
    middle = (np.arange(resolution) + 0.5) * 2 / resolution - 1
    x, y = np.meshgrid(middle, middle)
    radius, angle = np.hypot(x, y), np.arctan2(y, x)
    basis = [_radial(n, m, radius) * np.exp(-1j * m * angle) for n, m in ORDERS]
    return np.stack(basis, axis=-1) * (radius <= 1)[..., None]


def _radial(n: int, m: int, radius: Float[np.ndarray, 'rows columns']) -> Float[np.ndarray, 'rows columns']:
    out = np.zeros_like(radius)
    for k in range((n - m) // 2 + 1):
        share = factorial(k) * factorial((n + m) // 2 - k) * factorial((n - m) // 2 - k)
        out += (-1) ** k * factorial(n - k) / share * radius ** (n - 2 * k)
    return out


@njit(cache=True, nogil=True)
def draw_silhouette(
    points: np.ndarray, members: np.ndarray, centre: np.ndarray, right: np.ndarray, up: np.ndarray, scale: float,
    splat: float, image: np.ndarray
) -> None:  # fmt: skip
    """Draw points as discs into an image of the unit disc.

    Args:
        points: (N, 3) metres.
        members: Numbers of the points to draw.
        centre: (3,) metres, the middle of the image.
        right: (3,) unit, first image axis.
        up: (3,) unit, second image axis.
        scale: Metres that become 1.
        splat: Radius of a disc in the image.
        image: (P, P) bool, cleared first; pixels outside the unit disc stay empty.
    """
    image[:] = False
    size = len(image)
    for member in members:
        x, y = 0.0, 0.0
        for axis in range(3):
            away = (points[member, axis] - centre[axis]) / scale
            x += away * right[axis]
            y += away * up[axis]
        low_row = max(0, int(np.floor((y - splat + 1) * size / 2)))
        top_row = min(size - 1, int(np.floor((y + splat + 1) * size / 2)))
        low_column = max(0, int(np.floor((x - splat + 1) * size / 2)))
        top_column = min(size - 1, int(np.floor((x + splat + 1) * size / 2)))
        for row in range(low_row, top_row + 1):
            py = (row + 0.5) * 2 / size - 1
            for column in range(low_column, top_column + 1):
                px = (column + 0.5) * 2 / size - 1
                near = (px - x) ** 2 + (py - y) ** 2 <= splat * splat
                if near and px * px + py * py <= 1.0:
                    image[row, column] = True


@njit(cache=True, nogil=True)
def silhouette_features(image: np.ndarray, basis: np.ndarray, out: np.ndarray) -> None:
    """35 Zernike magnitudes, then 10 Fourier magnitudes of the outline; all in [0, 1], zero for an empty image.

    Zernike: |sum of the conjugate polynomial over the silhouette| / its area. The usual factor n + 1 is left out, so
    that no order outweighs the others. Fourier: the distance from the centroid to the farthest pixel in each of 32
    sectors; the magnitudes of its coefficients 1 to 10 over that of coefficient 0. Neither changes when the image is
    turned (but for the pixels) or mirrored.

    Args:
        image: (P, P) bool.
        basis: (P, P, 35) complex, see :func:`zernike_basis`.
        out: (45,) receives the features.
    """
    out[:] = 0.0
    moments = np.zeros(basis.shape[2], dtype=np.complex128)
    area, mean_row, mean_column = 0, 0.0, 0.0
    for row in range(image.shape[0]):
        for column in range(image.shape[1]):
            if image[row, column]:
                area += 1
                mean_row += row
                mean_column += column
                for k in range(len(moments)):
                    moments[k] += basis[row, column, k]
    if area == 0:
        return
    for k in range(len(moments)):
        out[k] = abs(moments[k]) / area
    mean_row, mean_column = mean_row / area, mean_column / area
    outline = np.zeros(SECTORS)
    for row in range(image.shape[0]):
        for column in range(image.shape[1]):
            if image[row, column]:
                dy, dx = row - mean_row, column - mean_column
                sector = int(np.floor(np.arctan2(dy, dx) / (2 * np.pi) * SECTORS)) % SECTORS
                outline[sector] = max(outline[sector], np.sqrt(dx * dx + dy * dy))
    total = outline.sum()
    if total == 0.0:
        return
    for k in range(FOURIER):
        real, imaginary = 0.0, 0.0
        for sector in range(SECTORS):
            angle = 2 * np.pi * (k + 1) * sector / SECTORS
            real += outline[sector] * np.cos(angle)
            imaginary += outline[sector] * np.sin(angle)
        out[basis.shape[2] + k] = np.sqrt(real * real + imaginary * imaginary) / total
