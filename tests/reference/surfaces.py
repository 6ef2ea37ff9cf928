"""Surfaces to describe, and a digest of a descriptor from a process of its own."""

import os
import subprocess
import sys

import numpy as np

from rm3d_plugin.structures import PointCloud


def bumpy(count=1500, seed=0):
    """A wavy sheet with nearly its exact normals: no pair leans equally. float32 values in float64."""
    rng = np.random.default_rng(seed)
    x, y = rng.random((2, count))
    z = 0.1 * np.sin(7 * x) * np.cos(5 * y)
    slope = [-0.7 * np.cos(7 * x) * np.cos(5 * y), 0.5 * np.sin(7 * x) * np.sin(5 * y), np.ones(count)]
    normals = np.stack(slope, axis=1) + rng.normal(0, 0.05, (count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.float64(np.float32(np.stack([x, y, z], axis=1))), np.float64(np.float32(normals))


def sphere(count, radius=1.0):
    """Points of a golden spiral."""
    steps = np.arange(count) + 0.5
    down, round_ = np.arccos(1 - 2 * steps / count), np.pi * (1 + 5**0.5) * steps
    return radius * np.stack([np.cos(round_) * np.sin(down), np.sin(round_) * np.sin(down), np.cos(down)], axis=1)


def rotation(seed):
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return turn * np.sign(np.linalg.det(turn))


def cloud(points, normals=None, **more):
    return PointCloud(np.float32(points), normals=None if normals is None else np.float32(normals), **more)


def digest(part, threads):
    """Hash of values and validity on 9000 points, computed by a process with so many threads."""
    code = (
        'import hashlib, numpy as np\n'
        'from rm3d_plugin.descriptors import *\n'
        'from rm3d_plugin.structures import PointCloud\n'
        f'got = {part}.compute(PointCloud(np.random.default_rng(0).random((9000, 3)) * [1, 1, .05]))\n'
        'print(hashlib.sha256(got.values.tobytes()).hexdigest(), got.valid.sum())'
    )
    names = ('NUMBA_NUM_THREADS', 'OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS')
    environment = {**os.environ, **dict.fromkeys(names, str(threads))}
    run = subprocess.run([sys.executable, '-c', code], env=environment, capture_output=True, text=True, check=True)
    assert not run.stdout.endswith(' 0\n')
    return run.stdout
