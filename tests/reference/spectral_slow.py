"""Spectral signatures with a dense generalised eigen-solver and loops over times (METHOD 3)."""

import numpy as np
import scipy.linalg


def slow_eigenpairs(laplacian, count):
    """Eigenvalues and functions of ``L phi = lambda D phi``, all of them computed."""
    values, functions = scipy.linalg.eigh(laplacian.stiffness.toarray(), np.diag(laplacian.mass))
    return values[:count], functions[:, :count]


def slow_hks(values, functions):
    """(N, 100) heat kernel divided by its trace."""
    times = np.exp(np.linspace(np.log(4 * np.log(10) / values[-1]), np.log(4 * np.log(10) / values[1]), 100))
    columns = []
    for t in times:
        heat = sum(np.exp(-v * t) * f**2 for v, f in zip(values[1:], functions.T[1:], strict=True))
        columns.append(heat / sum(np.exp(-v * t) for v in values[1:]))
    return np.stack(columns, axis=1)


def slow_wks(values, functions):
    """(N, 100) wave kernel."""
    energies = np.linspace(np.log(values[1]), np.log(values[-1]) / 1.02, 100)
    sigma = 6 * (energies[1] - energies[0])
    columns = []
    for e in energies:
        bands = [np.exp(-((e - np.log(v)) ** 2) / (2 * sigma**2)) for v in values[1:]]
        columns.append(sum(b * f**2 for b, f in zip(bands, functions.T[1:], strict=True)) / sum(bands))
    return np.stack(columns, axis=1)


def slow_sihks(values, functions):
    """(N, 6): the derivative as a central difference over 2e-4 of tau, the transform as a sum."""

    def log_heat(tau):
        t = 2.0**tau / (200 * values[-1])
        return np.log(sum(np.exp(-max(v, 0) * t) * f**2 for v, f in zip(values, functions.T, strict=True)))

    taus = np.arange(1, 25 + 1 / 32, 1 / 16)
    slopes = np.stack([(log_heat(tau + 1e-4) - log_heat(tau - 1e-4)) / 2e-4 for tau in taus], axis=1)
    places = np.arange(len(taus)) / len(taus)
    return np.abs(np.stack([slopes @ np.exp(-2j * np.pi * k * places) for k in range(6)], axis=1))
