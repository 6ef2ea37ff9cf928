"""Silhouette features by the formulas."""

import math

import numpy as np


def slow_zernike(image, n, m):
    """|sum over the silhouette of the conjugate Zernike polynomial| / its pixels."""
    size = len(image)
    total = 0j
    for row, column in np.argwhere(image):
        x, y = (column + 0.5) * 2 / size - 1, (row + 0.5) * 2 / size - 1
        rho, theta = math.hypot(x, y), math.atan2(y, x)
        radial = 0.0
        for k in range((n - m) // 2 + 1):
            factor = (-1) ** k * math.comb(n - k, k) * math.comb(n - 2 * k, (n - m) // 2 - k)
            radial += factor * rho ** (n - 2 * k)
        total += radial * complex(math.cos(m * theta), -math.sin(m * theta))
    return abs(total) / image.sum()


def slow_fourier(image, count=10, sectors=32):
    """Magnitudes of the outline's coefficients 1 to ``count`` over that of coefficient 0."""
    pixels = np.argwhere(image).astype(float)
    away = pixels - pixels.mean(axis=0)
    outline = np.zeros(sectors)
    for dy, dx in away:
        sector = math.floor(math.atan2(dy, dx) / (2 * math.pi) * sectors) % sectors
        outline[sector] = max(outline[sector], math.hypot(dx, dy))
    spectrum = np.abs(np.fft.fft(outline))
    return spectrum[1 : count + 1] / spectrum[0]


def slow_silhouette(points, right, up, radius, splat, size):
    """Pixels of the unit disc within ``splat`` of a projected point."""
    flat = np.stack([points @ right, points @ up], axis=1) / radius
    middle = (np.arange(size) + 0.5) * 2 / size - 1
    image = np.zeros((size, size), dtype=bool)
    for row in range(size):
        for column in range(size):
            x, y = middle[column], middle[row]
            near = ((flat - [x, y]) ** 2).sum(axis=1) <= splat**2
            image[row, column] = near.any() and x * x + y * y <= 1
    return image
