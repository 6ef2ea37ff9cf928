"""KITTI frames become items: crops, labels through the store only, bit-identical on resume."""

import pickle

import numpy as np
import pytest
import torch
from kitti_world import BOXES, CALIB, frame_points, make_world, write_frame
from mmengine.dataset import pseudo_collate
from mmengine.runner import Runner
from torch.utils.data import DataLoader

from rm3d_plugin.datasets import DatasetNotFoundError, KittiDataset
from rm3d_plugin.datasets.samplers import EpochSampler, epoch_order
from rm3d_plugin.label_budgets import hide
from rm3d_plugin.registry import DATA_SAMPLERS, DATASETS
from rm3d_plugin.storage import LabelStore, LabelStoreError
from rm3d_plugin.structures import SceneError

PIPELINE = [
    {'type': 'LabelledObjectPaste'},
    {'type': 'DropGround'},
    {'type': 'LimitPoints', 'max_points': 100},
    {'type': 'RandomFlipY'},
    {'type': 'GlobalRotScale'},
    {'type': 'AugmentedView', 'elastic': (1.0, 0.1)},
    {'type': 'PackScene'},
]


@pytest.fixture
def world(tmp_path):
    return make_world(tmp_path / 'kitti')


def fill_store(root, dataset, show=(0,), number=0):
    store = LabelStore(root)
    store.begin_round(number)
    for index, scene in enumerate(dataset.scene_ids):
        store.write(number, scene, hide(dataset.load_cloud(index).xyz, dataset.load_truth(index), show))
    store.finish_round(number)
    store.set_current(number)
    return store


def same(a, b):
    if isinstance(a, dict):
        assert a.keys() == b.keys()
        for key in a:
            same(a[key], b[key])
    elif isinstance(a, list):
        assert len(a) == len(b)
        for one, other in zip(a, b, strict=True):
            same(one, other)
    elif isinstance(a, torch.Tensor):
        assert a.dtype == b.dtype
        assert torch.equal(a, b)
    elif hasattr(a, 'all_items'):
        same(dict(a.all_items()), dict(b.all_items()))
    else:
        assert a == b


# ---------------------------------------------------------------------- clouds and truth


def test_crops_keep_points_in_view_and_range_in_order(world):
    dataset = KittiDataset(world)
    cloud = dataset.load_cloud(0)
    points = frame_points(0).astype(np.float32)
    expected = np.delete(points, [*range(120, 150), *range(350, 354)], axis=0)  # the far car, and what was made to go
    np.testing.assert_array_equal(cloud.xyz, expected[:, :3])
    np.testing.assert_array_equal(cloud.intensity, expected[:, 3])
    assert cloud.sensor.tolist() == [0, 0, 0]
    whole = KittiDataset(world, fov_only=False, point_range=(-100, -100, -5, 100, 100, 5)).load_cloud(0)
    np.testing.assert_array_equal(whole.xyz, points[:, :3])
    # aside of the camera but in range: only the view drops it
    assert len(KittiDataset(world, fov_only=False).load_cloud(0)) == len(cloud) + 1


def test_truth_holds_boxes_in_range_and_ignores_points_of_neighbouring_types(world):
    truth = KittiDataset(world).load_truth(0)
    np.testing.assert_allclose(truth.boxes.tensor, BOXES[:3], atol=1e-9)
    assert truth.boxes.labels.tolist() == [0, 0, 1]
    assert truth.semantic.tolist() == [0] * 60 + [1] * 30 + [-1] * 30 + [3] * 200
    assert truth.instance.tolist() == [0] * 30 + [1] * 30 + [2] * 30 + [-1] * 230
    cars = KittiDataset(world, classes=('Car',)).load_truth(0)
    assert cars.semantic.tolist() == [0] * 60 + [1] * 30 + [-1] * 30 + [1] * 200  # 1 is background here


def test_annotations_hold_every_object_for_the_metric(world):
    objects, calib, size = KittiDataset(world).annotations(2)
    assert [o.type for o in objects] == ['Car', 'Car', 'Pedestrian', 'Van', 'Car']
    np.testing.assert_array_equal(calib.P2, CALIB.P2)
    assert size == (1242, 375)


def test_every_frame_and_reduced_scans(world):
    (world / 'training' / 'velodyne').rename(world / 'training' / 'velodyne_reduced')
    dataset = KittiDataset(world, ann_file=None)
    assert dataset.scene_ids == ('000000', '000001', '000002', '000003')
    assert len(dataset.load_cloud(3)) == 320


def test_test_frames_have_no_labels(world):
    write_frame(world, '000007', frame_points(), folder='testing')
    dataset = KittiDataset(world, split='test', ann_file=None)
    assert dataset.scene_ids == ('000007',)
    assert dataset[0]['points'].shape == (320, 4)
    with pytest.raises(SceneError, match='keeps the labels of its test frames'):
        dataset.load_truth(0)


# ---------------------------------------------------------------------- items


def test_items_without_labels_hold_none(world):
    results = KittiDataset(world)[1]
    assert {'semantic', 'instance', 'is_annotated', 'boxes', 'box_labels', 'box_is_annotated', 'annotation'}.isdisjoint(
        results
    )
    assert results['scene_id'] == '000001'
    assert results['num_points'] == len(results['points']) == 320


def test_training_never_reads_the_truth(world, tmp_path, monkeypatch):
    fill_store(tmp_path / 'store', KittiDataset(world))

    def forbidden(*_):
        raise AssertionError('training touched the truth')

    for name in ('load_truth', 'annotations', 'annotation'):
        monkeypatch.setattr(KittiDataset, name, forbidden)
    dataset = KittiDataset(world, labels='store', label_store=tmp_path / 'store', pipeline=PIPELINE)
    for item in dataset:
        assert item['data_samples'].pts_is_annotated.any()
    # not even a file of labels has to be there
    for path in (world / 'training' / 'label_2').iterdir():
        path.unlink()
    assert len(list(dataset)) == 4


def test_stored_labels_are_attached(world, tmp_path):
    fill_store(tmp_path / 'store', KittiDataset(world), show=(1,))
    results = KittiDataset(world, labels='store', label_store=tmp_path / 'store')[0]
    assert results['semantic'].tolist() == [-1] * 30 + [0] * 30 + [-1] * 260
    assert results['instance'].tolist() == [-1] * 30 + [0] * 30 + [-1] * 260
    assert results['is_annotated'].sum() == 30
    np.testing.assert_allclose(results['boxes'], BOXES[[1]], atol=1e-9)
    assert results['box_is_annotated'].tolist() == [True]


def test_workers_that_live_on_see_the_new_round(world, tmp_path):
    plain = KittiDataset(world)
    store = fill_store(tmp_path / 'store', plain, show=(0,))
    dataset = KittiDataset(world, labels='store', label_store=tmp_path / 'store', pipeline=[{'type': 'PackScene'}])
    loader = DataLoader(
        dataset, batch_size=2, num_workers=1, persistent_workers=True, collate_fn=pseudo_collate, sampler=range(4)
    )
    boxes = [len(sample.gt_labels_3d) for batch in loader for sample in batch['data_samples']]
    fill_store(store.root, plain, show=(0, 1, 2), number=1)
    boxes += [len(sample.gt_labels_3d) for batch in loader for sample in batch['data_samples']]
    assert boxes == [1] * 4 + [3] * 4


def test_truth_is_attached_for_validation_only(world):
    item = KittiDataset(
        world, split='val', ann_file='ImageSets/val.txt', labels='truth', pipeline=[{'type': 'PackScene'}]
    )[2]
    sample = item['data_samples']
    assert sample.gt_labels_3d.tolist() == [0, 0, 1]
    assert sample.pts_semantic_mask.unique().tolist() == [-1, 0, 1, 3]
    assert len(sample.annotation.objects) == 5
    assert pickle.loads(pickle.dumps(sample)).scene_id == '000002'
    for split in ('train', 'trainval', 'test'):
        with pytest.raises(ValueError, match="labels='truth' is for split 'val'"):
            KittiDataset(world, split=split, labels='truth')


def test_an_item_is_a_function_of_seed_epoch_and_index(world, tmp_path):
    fill_store(tmp_path / 'store', KittiDataset(world), show=(0, 1))

    def build(seed=0):
        return KittiDataset(world, labels='store', label_store=tmp_path / 'store', pipeline=PIPELINE, seed=seed)

    first, second = build(), build()
    for item in (2, 7, 0, 5):
        list(first)  # whatever came before does not matter
        same(first[item], second[item])
    points = [build(0)[1], build(0)[5], build(1)[1], build(0)[2]]
    for i, a in enumerate(points):
        for b in points[i + 1 :]:
            assert not torch.equal(a['inputs']['points'], b['inputs']['points'])


def test_the_runner_of_mmengine_builds_the_loader(world, tmp_path):
    fill_store(tmp_path / 'store', KittiDataset(world))
    config = {
        'dataset': {
            'type': 'rm3d_plugin.KittiDataset', 'data_root': str(world), 'labels': 'store',
            'label_store': str(tmp_path / 'store'), 'pipeline': PIPELINE,
        },
        'sampler': {'type': 'rm3d_plugin.EpochSampler'}, 'batch_size': 2, 'num_workers': 0,
    }  # fmt: skip
    loader = Runner.build_dataloader(config, seed=5)
    order = {}
    for epoch in (0, 1, 0):
        loader.sampler.set_epoch(epoch)
        order.setdefault(epoch, []).append([s.scene_id for batch in loader for s in batch['data_samples']])
    assert order[0][0] == order[0][1]
    assert sorted(order[0][0]) == sorted(order[1][0]) == ['000000', '000001', '000002', '000003']
    assert loader.dataset.metainfo['classes'] == ('Car', 'Pedestrian', 'Cyclist')


# ---------------------------------------------------------------------- bad input


def test_a_missing_folder_says_where_it_was_looked_for_and_what_to_do(tmp_path):
    with pytest.raises(DatasetNotFoundError) as caught:
        KittiDataset(tmp_path / 'nowhere').full_init()
    message = str(caught.value)
    for words in (str(tmp_path / 'nowhere'), 'velodyne/', 'label_2/', 'cvlibs.net', 'data_root=', '--demo'):
        assert words in message


def test_a_missing_or_faulty_list_is_named(world):
    with pytest.raises(DatasetNotFoundError, match=r'no list .*minival\.txt; ann_file=None'):
        len(KittiDataset(world, ann_file='ImageSets/minival.txt'))
    (world / 'ImageSets' / 'train.txt').write_text('000001\n000001\n')
    with pytest.raises(SceneError, match=r'train\.txt: 2 frames, 1 of them twice'):
        len(KittiDataset(world))


def spoil(world):
    """Frame 1 is cut off, frame 2 holds a NaN, frame 3 has nothing in range."""
    folder = world / 'training' / 'velodyne'
    data = (folder / '000001.bin').read_bytes()
    (folder / '000001.bin').write_bytes(data[:-7])
    points = frame_points()
    points[3, 1] = np.nan
    write_frame(world, '000002', points)
    write_frame(world, '000003', np.array([[-5.0, 0, 0, 0]]))


def test_bad_scenes_raise_with_scene_and_file(world):
    spoil(world)
    dataset = KittiDataset(world)
    for index, match in (
        (1, r'scene 000001: .*000001\.bin.*16'),
        (2, 'scene 000002: .*1 of 354 points'),
        (3, 'none of 1 points'),
    ):
        with pytest.raises(SceneError, match=match):
            dataset[index]
    assert len(dataset[0]['points']) == 320


def test_bad_scenes_are_left_out_with_one_counted_warning(world):
    spoil(world)
    dataset = KittiDataset(world, bad_scenes='skip')
    with pytest.warns(
        UserWarning, match=r'3 of 4 scenes cannot be used and are left out: 000001: .*000001\.bin'
    ) as caught:
        assert len(dataset) == 1
    assert len(caught) == 1
    assert dataset.scene_ids == ('000000',)
    assert [item['scene_id'] for item in dataset] == ['000000']
    (world / 'training' / 'velodyne' / '000000.bin').write_bytes(b'')
    with pytest.raises(SceneError, match='none of 4 scenes can be used'):
        len(KittiDataset(world, bad_scenes='skip'))


def test_a_box_without_size_names_the_file_of_labels(world):
    path = world / 'training' / 'label_2' / '000001.txt'
    words = path.read_text().splitlines()[0].split()
    words[8] = '0'
    path.write_text(' '.join(words) + '\n')
    with pytest.raises(SceneError, match=r'000001\.txt: .*sizes must be positive, got 0.*remove the line'):
        KittiDataset(world).load_truth(1)


def test_labels_that_do_not_fit_the_scene_are_refused(world, tmp_path):
    dataset = KittiDataset(world, labels='store', label_store=tmp_path / 'store')
    with pytest.raises(LabelStoreError, match='no current round'):
        dataset[0]
    fill_store(tmp_path / 'store', KittiDataset(world, fov_only=False))
    with pytest.raises(SceneError, match='scene 000000: .* labels for 321 points, the scene has 320.*label again'):
        dataset[0]


def test_wrong_options_list_the_choices(world):
    for options, match in (
        ({'labels': 'all'}, "labels: expected one of none, store, truth, got 'all'"),
        ({'labels': 'store'}, 'needs label_store'),
        ({'bad_scenes': 'drop'}, 'bad_scenes: expected one of error, skip'),
        ({'split': 'minival'}, 'split: expected one of train, val'),
        ({'point_range': (0, 0, 0, 1, 1)}, 'point_range: expected'),
        ({'point_range': (0, 0, 0, 1, 0, 1)}, 'point_range: expected'),
    ):
        with pytest.raises(ValueError, match=match):
            KittiDataset(world, **options)
    with pytest.raises(IndexError):
        KittiDataset(world)[-1]


# ---------------------------------------------------------------------- order


@pytest.mark.parametrize('world_size', [1, 2, 3, 7])
@pytest.mark.parametrize('length', [1, 5, 12])
def test_all_ranks_together_visit_every_scene(length, world_size):
    padded = [epoch_order(length, 3, 1, rank=rank, world_size=world_size) for rank in range(world_size)]
    assert len({len(part) for part in padded}) == 1
    assert set(np.concatenate(padded).tolist()) == set(range(length))
    exact = [epoch_order(length, 3, 1, rank=r, world_size=world_size, round_up=False) for r in range(world_size)]
    assert sorted(np.concatenate(exact).tolist()) == list(range(length))


def test_the_order_depends_on_seed_and_epoch_only():
    np.testing.assert_array_equal(epoch_order(50, 1, 2), np.random.default_rng([1, 2]).permutation(50))
    assert (epoch_order(50, 1, 2) != epoch_order(50, 2, 1)).any()
    assert epoch_order(4, 1, 2, shuffle=False).tolist() == [0, 1, 2, 3]
    assert epoch_order(0, 1, 2).tolist() == []


def test_sampler_tells_items_their_epoch(monkeypatch):
    sampler = DATA_SAMPLERS.build(
        {'type': 'EpochSampler', 'shuffle': False}, default_args={'dataset': range(5), 'seed': 1}
    )
    assert list(sampler) == [0, 1, 2, 3, 4]
    sampler.set_epoch(3)
    assert list(sampler) == [15, 16, 17, 18, 19]
    for world_size, round_up in ((2, True), (2, False), (3, False), (7, True), (7, False)):
        for rank in range(world_size):
            monkeypatch.setattr('rm3d_plugin.datasets.samplers.get_dist_info', lambda r=rank, w=world_size: (r, w))
            sampler = EpochSampler(range(5), seed=None, round_up=round_up)
            assert len(list(sampler)) == len(sampler)


# ---------------------------------------------------------------------- real frames


def test_real_frames(real_data, tmp_path):
    dataset = DATASETS.build({'type': 'KittiDataset', 'data_root': real_data / 'kitti'})
    assert len(dataset) == 8
    cloud, truth = dataset.load_cloud(0), dataset.load_truth(0)
    assert truth.boxes.labels.tolist() == [1]  # frame 000000 shows one pedestrian, 377 points
    assert ((truth.instance == 0) == (truth.semantic == 1)).all()
    assert (truth.semantic == 1).sum() == 377
    assert len(cloud) == 20748
    fill_store(tmp_path / 'store', dataset, show=(0,))
    training = KittiDataset(real_data / 'kitti', labels='store', label_store=tmp_path / 'store', pipeline=PIPELINE[1:2])
    kept = training[0]
    assert 2000 < len(kept['points']) < 15000
    assert kept['is_annotated'].sum() > 300  # dropping the ground leaves the pedestrian
    np.testing.assert_array_equal(kept['points'][:, :3], cloud.xyz[kept['point_index']])
