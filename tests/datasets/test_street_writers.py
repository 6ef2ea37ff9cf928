"""Synthetic streets in the native files of segmentation data sets: the readers read back exactly what was written."""

import hashlib
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from rm3d_plugin.datasets.semantic3d import HOLDOUT, Semantic3DDataset
from rm3d_plugin.datasets.semantickitti import SemanticKittiDataset
from rm3d_plugin.datasets.semantickitti_format import CLASSES, merge_ids
from rm3d_plugin.datasets.synthetic import (
    make_demo,
    make_semantic3d_streets,
    make_semantickitti_streets,
    make_vkitti_streets,
    semantic3d_writer,
    semantickitti_writer,
    street_extras,
    street_scans,
    vkitti_writer,
)
from rm3d_plugin.datasets.synthetic.lidar import SpinningLidar
from rm3d_plugin.datasets.synthetic.parts import Part, paint
from rm3d_plugin.datasets.vkitti import CLASSES as VKITTI_CLASSES
from rm3d_plugin.datasets.vkitti import VKITTI3DDataset

COARSE = SpinningLidar(azimuth_step=2.0)
KITTI_HASH = 'ae77470b7166ff977164936d44c5f1de2b581421b269587bc7b8dd09fd22ddee'
STATION_HASH = '04501cd436d068b2cd33dbe6d73f4d0ef4ebfffd288931a7f76702b7cb3a56fe'
FRAME_HASH = 'b66ed337d439821f743f57e1f0f9abe2720cd6910c0f65cbbe3c72eb01675dcb'


def snapshot(root: Path) -> dict[str, str]:
    files = sorted(path for path in root.rglob('*') if path.is_file())
    return {str(path.relative_to(root)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def sha(*arrays: np.ndarray) -> str:
    return hashlib.sha256(b''.join(np.ascontiguousarray(array).tobytes() for array in arrays)).hexdigest()


def make_kitti(root: Path, **changes: int) -> Path:
    given = {'num_train': 3, 'num_val': 2, 'seed': 5, 'azimuth_step': 2.0, 'scans_per_street': 2} | changes
    return make_semantickitti_streets(root, progress=False, **given)


@pytest.fixture(scope='module')
def kitti(tmp_path_factory) -> Path:
    return make_kitti(tmp_path_factory.mktemp('kitti') / 'demo')


@pytest.fixture
def own_kitti(kitti: Path, tmp_path: Path) -> Path:
    """A copy that the test may change."""
    return shutil.copytree(kitti, tmp_path / 'demo')


# ---------------------------------------------------------------------- what stands in a street


@pytest.fixture(scope='module')
def scenes() -> list[street_scans.Scene]:
    return [street_scans.make_scene(0, number) for number in range(8)]


def test_every_kind_but_parking_stands_somewhere(scenes: list[street_scans.Scene]) -> None:
    found = set(np.concatenate([np.unique(scene.mesh.part) for scene in scenes]).tolist())
    assert found == {int(part) for part in Part} - {Part.PARKING}  # that one is told by the place on the road


def test_a_thing_is_of_one_kind(scenes: list[street_scans.Scene]) -> None:
    things = {Part.CAR, Part.VAN, Part.TRUCK, Part.TRAILER, Part.BICYCLE, Part.MOTORCYCLE, Part.PERSON, Part.BICYCLIST}
    for scene in scenes:
        for owner in range(int(scene.owner.max()) + 1):
            kinds = set(scene.mesh.part[scene.owner == owner].tolist())
            assert len(kinds) == 1 or not kinds & things


def test_the_ground_is_named_by_where_it_lies(scenes: list[street_scans.Scene]) -> None:
    number, scene = next((n, s) for n, s in enumerate(scenes) if s.road.parked_left)
    pose = street_scans.pose_on_road(scene.road, 0.0)
    scan = street_scans.scan_scene(scene, pose, COARSE, street_scans.generator(0, number, 2))
    offset = scan.xyz[:, 1] - scene.road.bend * scan.xyz[:, 0] ** 2
    road = scene.road
    of = {part: offset[scan.part == part] for part in Part}
    assert (of[Part.ROAD] < road.left - 2.2).all() and (of[Part.ROAD] > road.right - 0.1).all()
    left = of[Part.PARKING][of[Part.PARKING] > 0]
    assert len(left) and (left > road.left - 2.2).all() and (left < road.left + 0.1).all()
    sidewalk = of[Part.SIDEWALK]
    assert ((sidewalk > road.left - 0.1) | (sidewalk < road.right + 0.1)).all()
    assert (np.abs(of[Part.TERRAIN]) > min(road.left, -road.right) + road.pavement - 0.2).all()


@pytest.mark.parametrize('maker', ['truck', 'bus', 'motorcycle', 'motorcyclist'])
def test_extras_fill_the_size_they_tell(maker: str) -> None:
    rng = np.random.default_rng(1)
    for _ in range(5):
        mesh, size = getattr(street_extras, maker)(rng)
        low, high = mesh.bounds
        assert -0.3 < low[2] < 0.15
        assert (np.abs((high - low) - size) < [0.25, 0.35, 0.35]).all()
        assert len(np.unique(mesh.part)) == 1 and mesh.part[0] > 0


def test_paint_depends_on_thing_and_kind() -> None:
    part, owner = np.repeat([Part.ROAD, Part.CAR, Part.CAR], 200), np.repeat([0, 1, 2], 200)
    colors = paint(part, owner, np.random.default_rng(0))
    assert colors.min() >= 0 and colors.max() <= 255
    spread = [colors[owner == thing].std(axis=0).max() for thing in range(3)]
    assert max(spread) < 12 / np.sqrt(3) + 2
    assert paint(part[:0], owner[:0], np.random.default_rng(0)).shape == (0, 3)


# ---------------------------------------------------------------------- SemanticKITTI


def test_semantickitti_reads_back_exactly(kitti: Path) -> None:
    root = kitti
    assert 'SYNTHETIC' in (root / 'README.txt').read_text()
    dataset = SemanticKittiDataset(root, sequences=[0, 1])
    assert dataset.scene_ids == ('00_000000', '00_000001', '01_000000')
    for index, (street, step) in enumerate([(0, 0), (0, 1), (1, 0)]):
        scan, pose = semantickitti_writer.make_scan(5, street, step, COARSE)
        raw, instance = semantickitti_writer.raw_labels(scan)
        cloud, truth = dataset.load_cloud(index), dataset.load_truth(index)
        np.testing.assert_array_equal(cloud.xyz, scan.xyz.astype(np.float32))
        np.testing.assert_array_equal(cloud.intensity, scan.intensity.astype(np.float32))
        np.testing.assert_array_equal(truth.semantic, merge_ids(raw, 'made'))
        assert ((truth.instance >= 0) == (truth.semantic >= 0) & (truth.semantic < 8)).all()
        pairs = np.unique(np.stack([truth.instance, instance])[:, truth.instance >= 0], axis=1)
        assert len(np.unique(pairs[0])) == pairs.shape[1] == len(np.unique(pairs[1]))  # one to one
        np.testing.assert_allclose(dataset.pose(index), pose, atol=1e-6)
    assert len(SemanticKittiDataset(root, 'val', labels='truth')) == 2


def test_successive_scans_fit_each_other(tmp_path: Path) -> None:
    given = {'num_train': 2, 'num_val': 0, 'seed': 1, 'azimuth_step': 0.7}
    dataset = SemanticKittiDataset(make_kitti(tmp_path / 'demo', **given), sequences=[0])
    upright = [CLASSES.index(name) for name in ('car', 'trunk', 'pole', 'person', 'bicycle')]
    seen, placed = [], []
    for index in range(2):
        xyz = dataset.load_cloud(index).xyz[np.isin(dataset.load_truth(index).semantic, upright)]
        seen.append(xyz)
        placed.append(xyz @ dataset.pose(index)[:3, :3].T + dataset.pose(index)[:3, 3])
    assert min(map(len, seen)) > 100
    fit, apart = (np.median(cKDTree(clouds[1]).query(clouds[0])[0]) for clouds in (placed, seen))
    assert fit < 0.15 and fit < 0.5 * apart
    np.testing.assert_allclose(dataset.pose(1)[:2, 3] - dataset.pose(0)[:2, 3], [1, 0], atol=0.01)


def test_raw_ids_rest_and_move(scenes: list[street_scans.Scene]) -> None:
    lidar, ids = SpinningLidar(azimuth_step=1.0), []
    for number, scene in enumerate(scenes):
        pose = street_scans.pose_on_road(scene.road, 0.0)
        scan = street_scans.scan_scene(scene, pose, lidar, street_scans.generator(0, number, 2))
        raw, instance = semantickitti_writer.raw_labels(scan)
        ids.append(raw)
        assert ((instance > 0) == np.isin(merge_ids(raw, 'made'), np.arange(8))).all()
    found = set(np.unique(np.concatenate(ids)).tolist())
    assert {10, 252, 30, 254, 31, 253, 11, 15, 40, 48, 50, 51, 70, 71, 72, 80, 81, 99} <= found


# ---------------------------------------------------------------------- Semantic3D and vKITTI 3D


def test_semantic3d_reads_back_exactly(tmp_path: Path) -> None:
    root = make_semantic3d_streets(tmp_path / 'demo', 1, 1, seed=5, step=2.0, progress=False)
    with pytest.warns(UserWarning, match='2 of 3 stations'):
        dataset = Semantic3DDataset(root, 'val', voxel_downsample=0.001, labels='truth')
        assert dataset.scene_ids == HOLDOUT[:1]
    rows, labels = semantic3d_writer.make_station(5, street_scans.VAL_STREETS, semantic3d_writer.make_scanner(2.0))
    cloud, truth = dataset.load_cloud(0), dataset.load_truth(0)
    unique = len(np.unique(rows[:, :3], axis=0))
    back = dataset.original_index(0)
    assert len(back) == len(rows) and len(cloud) <= unique and len(cloud) > 0.99 * unique
    first = np.unique(back, return_index=True)[1]
    np.testing.assert_array_equal(cloud.xyz, (rows[first, :3] / 1000).astype(np.float32))
    np.testing.assert_allclose(cloud.colors, rows[first, 4:] / 255, atol=1e-7)
    np.testing.assert_allclose(cloud.intensity, (rows[first, 3] + 2048) / 4095, atol=1e-6)
    alone = np.bincount(back)[back[first]] == 1
    np.testing.assert_array_equal(truth.semantic[alone], labels[first][alone] - 1)
    assert (truth.semantic == -1).mean() < 0.04
    assert set(truth.semantic.tolist()) >= {-1, 0, 2, 5, 7}


def test_vkitti_reads_back_exactly(tmp_path: Path) -> None:
    root = make_vkitti_streets(tmp_path / 'demo', 6, 2, seed=5, step=1.0, progress=False)
    dataset = VKITTI3DDataset(root, 'test', labels='truth')
    assert dataset.scene_ids == ('06_0001_00000', '06_0001_00001')
    assert len(VKITTI3DDataset(root)) == 6
    for index in range(2):
        frame = vkitti_writer.make_frame(5, street_scans.VAL_STREETS + index, vkitti_writer.make_sensor(1.0))
        cloud, truth = dataset.load_cloud(index), dataset.load_truth(index)
        np.testing.assert_array_equal(cloud.xyz, frame[:, :3].astype(np.float32))
        np.testing.assert_allclose(cloud.colors, frame[:, 3:6] / 255, atol=1e-7)
        np.testing.assert_array_equal(truth.semantic, frame[:, 6])
        assert (np.abs(cloud.xyz[:, 1]) < 0.62 * cloud.xyz[:, 0]).all()
    road = cloud.xyz[truth.semantic == VKITTI_CLASSES.index('road')]
    assert abs(np.median(road[road[:, 0] < 10, 2]) + 1.73) < 0.2


# ---------------------------------------------------------------------- the same everywhere, and never half


def test_bytes_never_change() -> None:
    scan, pose = semantickitti_writer.make_scan(7, 3, 1, COARSE)
    raw, instance = semantickitti_writer.raw_labels(scan)
    assert sha(scan.xyz.astype('<f4'), scan.intensity.astype('<f4'), raw, instance, np.round(pose, 6)) == KITTI_HASH
    assert sha(*semantic3d_writer.make_station(7, 3, semantic3d_writer.make_scanner(3.0))) == STATION_HASH
    assert sha(vkitti_writer.make_frame(7, 3, vkitti_writer.make_sensor(1.0)).astype('<f4')) == FRAME_HASH


def test_finished_sets_stay_and_interrupted_ones_go_on(own_kitti: Path) -> None:
    root = own_kitti
    before, times = snapshot(root), {path: path.stat().st_mtime_ns for path in root.rglob('*')}
    make_kitti(root)
    assert {path: path.stat().st_mtime_ns for path in root.rglob('*')} == times
    marker = json.loads((root / 'demo.json').read_text())
    (root / 'demo.json').write_text(json.dumps(marker | {'finished': False}))
    for path in sorted((root / 'sequences' / '08').rglob('*'), reverse=True):
        path.rmdir() if path.is_dir() else path.unlink()
    (root / 'sequences' / '08').rmdir()
    kept = root / 'sequences' / '00' / 'velodyne' / '000000.bin'
    make_kitti(root)
    assert snapshot(root) == before
    assert kept.stat().st_mtime_ns == times[kept]


def test_other_parameters_make_it_anew(own_kitti: Path) -> None:
    root = own_kitti
    before = snapshot(root)
    fewer = snapshot(make_kitti(root, num_train=2))
    assert 'sequences/01/velodyne/000000.bin' not in fewer
    same = [name for name in fewer if name.startswith(('sequences/00', 'sequences/08'))]
    assert same and all(fewer[name] == before[name] for name in same)
    assert (
        snapshot(make_kitti(root, seed=6, num_train=1, num_val=1))['sequences/08/velodyne/000000.bin']
        != before['sequences/08/velodyne/000000.bin']
    )


def test_foreign_folders_and_bad_numbers_are_refused(tmp_path: Path) -> None:
    (tmp_path / 'mine.txt').write_text('keep me')
    for name in ('semantickitti_streets', 'semantic3d_streets', 'vkitti_streets'):
        with pytest.raises(ValueError, match='holds files but no demo.json'):
            make_demo(tmp_path, name, num_train=1, num_val=1)
        with pytest.raises(ValueError, match='num_train=0, num_val=0'):
            make_demo(tmp_path / 'a', name, num_train=0, num_val=0)
    assert [path.name for path in tmp_path.iterdir()] == ['mine.txt']
    with pytest.raises(ValueError, match='at most num_train=12 and num_val=3 stations, got 13 and 0'):
        make_semantic3d_streets(tmp_path / 'a', 13, 0)
    with pytest.raises(ValueError, match='scans_per_street: expected 1 to 20'):
        make_kitti(tmp_path / 'a', scans_per_street=0)
