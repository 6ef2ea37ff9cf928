"""The simulators stay honest: what is measured on made-up scans lies where real scans lie."""

import numpy as np
import pytest

from rm3d_plugin.datasets.synthetic.lidar import SpinningLidar
from rm3d_plugin.datasets.synthetic.rooms import make_room
from rm3d_plugin.evaluation import realism
from rm3d_plugin.evaluation.functional import scan_statistics, street_statistics
from rm3d_plugin.evaluation.functional.rank_auc import rank_auc

ROOMS, STREETS = 5, 12  # shares of classes differ much from street to street


@pytest.mark.slow
def test_rooms_are_like_real_ones() -> None:
    rows = [realism.measure_room(make_room(0, number)) for number in range(ROOMS)]
    made = realism.summary(rows)
    outside = {key: made[key] for key, real in realism.REAL_ROOMS.items() if not real.holds(made[key].median)}
    assert not outside
    # Nor is it chance: most rooms lie in the range by themselves.
    inside = np.mean([[real.holds(row[key]) for key, real in realism.REAL_ROOMS.items()] for row in rows])
    assert inside > 0.85


@pytest.mark.slow
def test_streets_are_like_real_ones() -> None:
    made = realism.summary([realism.measure_street(0, number, SpinningLidar()) for number in range(STREETS)])
    outside = {key: made[key] for key, real in realism.REAL_STREETS.items() if not real.holds(made[key].median)}
    assert not outside


def test_ranges_hold_what_lies_in_them() -> None:
    real = realism.Range(2.0, 1.0, 3.0)
    assert real.holds(1.0) and real.holds(3.0) and not real.holds(3.1)
    made = realism.summary([{'a': 1.0, 'b': np.nan}, {'a': 5.0, 'b': np.nan}, {'a': 2.0, 'b': np.nan}])
    assert made == {'a': realism.Range(2.0, 1.0, 5.0)}
    lines = list(realism.table({'a': realism.Range(9.0, 1.0, 9.0)}, {'a': real}))
    assert lines[1].split() == ['a', '2', '(1', 'to', '3)', '9', '(1', 'to', '9)', 'outside']


# ------------------------------------------------------------------ the quantities, against slow twins


def test_rank_auc_equals_counting_pairs() -> None:
    rng = np.random.default_rng(0)
    values, positive = rng.integers(0, 6, 40).astype(float), rng.random(40) < 0.4
    wins = [(a > b) + 0.5 * (a == b) for a in values[positive] for b in values[~positive]]
    assert rank_auc(values, positive) == pytest.approx(np.mean(wins))
    assert np.isnan(rank_auc(values, np.zeros(40, dtype=bool)))


def corner() -> tuple[np.ndarray, np.ndarray]:
    """A floor and a wall of a point each two centimetres, and which is which."""
    grid = np.stack(np.meshgrid(np.arange(40), np.arange(40)), axis=-1).reshape(-1, 2) * 0.02
    floor = np.concatenate([grid, np.zeros((1600, 1))], axis=1)
    wall = np.stack([np.full(1600, -0.02), grid[:, 0], grid[:, 1] + 0.02], axis=1)
    rough = 1e-4 * np.random.default_rng(0).standard_normal((3200, 3))
    return np.concatenate([floor, wall]) + rough, np.repeat([0, 1], 1600)


def test_a_corner_of_two_planes() -> None:
    xyz, side = corner()
    rgb = np.where(side[:, None] == 0, 0.2, 0.8) * np.ones(3)
    told = scan_statistics.room_statistics(xyz, rgb, side, np.full(len(xyz), -1))
    assert told.spacing_cm == pytest.approx(2.0, abs=0.05) and told.extent_m == pytest.approx(0.8, abs=0.03)
    assert told.noise_mm == pytest.approx(0.1, abs=0.03) and told.curvature_p50 < 1e-4
    assert told.step_inside_deg < 1 and told.step_across_deg > 5
    assert told.auc_color == 1.0 and told.color_spread == pytest.approx(0.0, abs=1e-9)
    assert told.unannotated_pct == 0 and (told.objects, told.object_points) == (2, 1600)
    distance = np.linalg.norm(xyz[:, None] - xyz[None], axis=-1)
    near = ((distance < 0.05) & (side[:, None] != side[None])).any(axis=1)
    assert told.near_border_pct == pytest.approx(100 * near.mean())
    half = scan_statistics.room_statistics(xyz, rgb, np.where(side == 0, 0, -1), np.full(len(xyz), -1))
    assert half.unannotated_pct == 50 and half.pairs_across_pct == 0 and np.isnan(half.auc_color)
    with pytest.raises(ValueError, match='more than 32 points, got 3'):
        scan_statistics.room_statistics(xyz[:3], rgb[:3], side[:3], side[:3])


def test_instances_are_objects_of_their_own() -> None:
    xyz, side = corner()
    instance = np.where(side == 1, (xyz[:, 1] > 0.4).astype(int), -1)
    told = scan_statistics.room_statistics(xyz, np.full((len(xyz), 3), 0.5), side, instance)
    assert told.objects == 3


def test_kerb_and_roughness() -> None:
    rng = np.random.default_rng(0)
    xyz = np.concatenate([rng.uniform(-5, 5, (4000, 2)), 0.003 * rng.standard_normal((4000, 1))], axis=1)
    road = xyz[:, 1] < 0
    xyz[~road, 2] += 0.04
    assert street_statistics.kerb_step(xyz, road, ~road) == pytest.approx(4.0, abs=0.2)
    assert street_statistics.road_roughness(xyz[road]) == pytest.approx(3.0, abs=0.5)
    assert np.isnan(street_statistics.road_roughness(xyz[:100]))
    assert np.isnan(street_statistics.kerb_step(xyz, road & (xyz[:, 0] > 4.9), ~road))


def test_a_scan_of_two_surfaces() -> None:
    rng = np.random.default_rng(0)
    xyz = np.concatenate([rng.uniform(-8, 8, (600, 2)), np.zeros((600, 1))], axis=1)
    raw = np.repeat([40, 48, 0], 200)
    told = street_statistics.street_statistics(xyz, np.where(raw == 40, 0.2, 0.4), raw, np.zeros(600, dtype=np.int64))
    assert told['unlabelled_pct'] == pytest.approx(100 / 3) and told['points'] == 600
    assert told['auc_road_pavement'] == 1.0 and told['spread_road'] == pytest.approx(0.0)
    assert np.isnan(told['auc_pole_trunk']) and np.isnan(told['car_points'])
    assert street_statistics.intensity_auc(np.zeros(10), np.zeros(80)) != 0.5  # too few
