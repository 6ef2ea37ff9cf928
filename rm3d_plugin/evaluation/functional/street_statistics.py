"""What a labelled lidar scan of a street is like: the ground's shape, intensities by class and shares of classes.

They tell whether made-up streets are as hard as real ones, whose values `rm3d_plugin.evaluation.realism` holds.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.evaluation.functional.rank_auc import rank_auc
from rm3d_plugin.ops.octree import Octree

# SemanticKITTI's raw ids.
RAW = {
    'car': 10, 'road': 40, 'parking': 44, 'pavement': 48, 'building': 50, 'fence': 51, 'vegetation': 70, 'trunk': 71,
    'terrain': 72, 'pole': 80,
}  # fmt: skip
NEAR = 30.0  # m; intensities are compared as far as here
ROAD_NEAR, KERB_NEAR = 15.0, 20.0  # m; the ground's shape is measured as far as here
PATCH = 30  # points of a patch of road
LEAST = 50  # points; of fewer no intensity is told
STEP_GAP = 0.5  # m between a point of the pavement and the nearest one of the road, seen from above
COMPARED = (
    ('road', 'pavement'), ('road', 'terrain'), ('pavement', 'terrain'), ('road', 'parking'), ('building', 'vegetation'),
    ('vegetation', 'trunk'), ('vegetation', 'fence'), ('pole', 'trunk'),
)  # fmt: skip
SPREADS = ('road', 'building', 'vegetation', 'car')
SHARES = ('car', 'trunk', 'pole', 'vegetation', 'building', 'terrain')


def street_statistics(
    xyz: Float[np.ndarray, 'points 3'],
    intensity: Float[np.ndarray, ' points'],
    raw: Int[np.ndarray, ' points'],
    instance: Int[np.ndarray, ' points'],
) -> dict[str, float]:
    """Statistics of a scan with SemanticKITTI's raw labels; NaN where the scan has nothing to measure.

    Args:
        xyz: Metres, sensor frame, z up.
        intensity: In [0, 1].
        raw: Raw ids, 0 = not labelled.
        instance: Numbers of things.

    Returns:
        By name: ``points``, ``unlabelled_pct``, ``range_m`` (median, in the plane), ``road_rough_mm``, ``kerb_cm``,
        ``spread_CLASS`` (deviation of the intensity), ``auc_A_B`` (how well the intensity tells two classes apart,
        0.5 = not at all), ``share_CLASS_pct``, ``car_points`` (median of a car that stands).
    """
    distance = np.hypot(xyz[:, 0], xyz[:, 1])
    of = {name: raw == number for name, number in RAW.items()}
    near = {name: intensity[mask & (distance < NEAR)] for name, mask in of.items()}
    out = {
        'points': float(len(xyz)),
        'unlabelled_pct': 100 * float((raw == 0).mean()),
        'range_m': float(np.median(distance)),
        'road_rough_mm': road_roughness(xyz[of['road'] & (distance < ROAD_NEAR)]),
        'kerb_cm': kerb_step(xyz, of['road'] & (distance < ROAD_NEAR), of['pavement'] & (distance < KERB_NEAR)),
    }
    for name in SPREADS:
        out[f'spread_{name}'] = float(near[name].std()) if len(near[name]) > LEAST else float('nan')
    for a, b in COMPARED:
        out[f'auc_{a}_{b}'] = intensity_auc(near[a], near[b])
    for name in SHARES:
        out[f'share_{name}_pct'] = 100 * float(of[name].mean())
    cars = np.unique(instance[of['car']], return_counts=True)[1]
    out['car_points'] = float(np.median(cars)) if len(cars) else float('nan')
    return out


def intensity_auc(a: Float[np.ndarray, ' some'], b: Float[np.ndarray, ' others']) -> float:
    """How well a value tells two groups apart, whichever has the larger ones; NaN where one has too few points."""
    if min(len(a), len(b)) < LEAST:
        return float('nan')
    first = np.arange(len(a) + len(b)) < len(a)
    value = rank_auc(np.concatenate([a, b]), first)
    return max(value, 1 - value)


def road_roughness(road: Float[np.ndarray, 'points 3'], most: int = 2000) -> float:
    """Median deviation of 30 neighbouring points of the road from their plane, millimetres."""
    if len(road) <= 500:
        return float('nan')
    queries = road[:: max(1, len(road) // most)]
    patch = road[Octree(road).knn(queries, PATCH).indices]
    patch = patch - patch.mean(axis=1, keepdims=True)
    values = np.linalg.eigvalsh(np.matmul(patch.transpose(0, 2, 1), patch) / PATCH)
    return 1000 * float(np.median(np.sqrt(np.maximum(values[:, 0], 0.0))))


def kerb_step(
    xyz: Float[np.ndarray, 'points 3'], road: Bool[np.ndarray, ' points'], pavement: Bool[np.ndarray, ' points']
) -> float:
    """Median height of pavement over the nearest road at most half a metre beside it, centimetres."""
    if min(road.sum(), pavement.sum()) <= 200:
        return float('nan')
    flat = xyz * np.array([1.0, 1.0, 0.0])
    found = Octree(flat[road]).knn(flat[pavement], 1)
    beside = found.sq_dists[:, 0] < STEP_GAP**2
    if beside.sum() <= 20:
        return float('nan')
    step = xyz[pavement, 2] - xyz[road, 2][found.indices[:, 0]]
    return 100 * float(np.median(step[beside]))
