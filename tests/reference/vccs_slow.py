"""VCCS with dictionaries and loops."""

import itertools
import math

import numpy as np

CORNER = np.array([0.8192, 0.6710, 0.5497])  # where the least coordinates lie within a cell
TIE = 1e-3  # shares of a squared distance that make no difference


def _mean(rows):
    return np.mean(np.asarray(rows, dtype=np.float64), axis=0)


def slow_distance(a, b, seed_size, color, spatial, shape, scale):
    """Papon's distance between (xyz, lab, histogram) triples, squared."""
    d_color = float(((a[1] - b[1]) ** 2).sum()) / scale**2
    d_space = float(((a[0] - b[0]) ** 2).sum()) / (3 * seed_size**2)
    d_shape = (1 - float(np.minimum(a[2], b[2]).sum())) ** 2 if a[2].sum() > 0 else 0.0
    return color * d_color + spatial * d_space + shape * d_shape


def slow_vccs(xyz, lab, histograms, voxel, seed, color=0.1, spatial=0.4, shape=1.0, scale=15.0):
    """Supervoxel of each point, any numbers; -1 where none arrived."""

    def unit(h):
        return h / h.sum() if h.sum() > 0 else h

    low = np.float64(xyz).min(axis=0)
    xyz = np.float64(xyz) - low
    cells = [tuple(math.floor(v / voxel + c) for v, c in zip(p, CORNER, strict=True)) for p in xyz]
    names = sorted(set(cells))
    members = {name: [i for i, cell in enumerate(cells) if cell == name] for name in names}
    feature = {
        name: (_mean(xyz[rows]), _mean(lab[rows]), unit(_mean(histograms[rows]))) for name, rows in members.items()
    }
    coarse = sorted(
        {tuple(math.floor(v / seed + c) for v, c in zip(feature[name][0], CORNER, strict=True)) for name in names}
    )
    seeds = set()
    for cell in coarse:
        centre = (np.array(cell) + 0.5 - CORNER) * seed
        seeds.add(min(names, key=lambda n: (((feature[n][0] - centre) ** 2).sum(), n)))  # noqa: B023
    least = 0.05 * math.pi * (seed / 2) ** 2 / voxel**2
    kept = []
    for name in sorted(seeds):
        near = [n for n in names if ((feature[n][0] - feature[name][0]) ** 2).sum() <= (seed / 2) ** 2]
        if len(near) >= least:
            kept.append(name)
    owner = {name: number for number, name in enumerate(kept)}
    centre = {number: feature[name] for number, name in enumerate(kept)}
    for _ in range(int(1.8 * seed / voxel)):
        after = dict(owner)
        for name in names:
            around = [
                tuple(np.add(name, step)) for step in itertools.product((-1, 0, 1), repeat=3) if step != (0, 0, 0)
            ]
            options = {owner[n] for n in around if n in owner} | ({owner[name]} if name in owner else set())
            if options:
                key = {o: slow_distance(feature[name], centre[o], seed, color, spatial, shape, scale) for o in options}
                near = {o for o in options if key[o] <= min(key.values()) * (1 + TIE)}
                after[name] = owner[name] if owner.get(name) in near else min(near)
        owner = after
        for number in range(len(kept)):
            mine = [feature[n] for n in names if owner.get(n) == number]
            if mine:
                centre[number] = (_mean([m[0] for m in mine]), _mean([m[1] for m in mine]), None)
                centre[number] = (*centre[number][:2], unit(_mean([m[2] for m in mine])))
    return np.array([owner.get(cell, -1) for cell in cells])
