"""Scenes that segmentation must bear: a class missing, no colour, one region, one point, far coordinates."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
from labeling import rounds
from mmengine.dataset import pseudo_collate
from mmengine.registry import DefaultScope
from reference.toy_scenes import CLASSES, make_scene

from rm3d_plugin.datasets.segmentation import RawScene, SegmentationDataset, make_cloud
from rm3d_plugin.datasets.transforms import pack_scene
from rm3d_plugin.engine.config import load_config
from rm3d_plugin.labeling import PointBudgetSource, SegmentationLabelMaker
from rm3d_plugin.labeling.sources import LabelSource
from rm3d_plugin.models.segmentors import RM3DSegmentor, segmentation_losses
from rm3d_plugin.pseudo_labels import AnnotatedLabels, PointPrediction
from rm3d_plugin.registry import SCOPE, TRANSFORMS
from rm3d_plugin.structures import Boxes3D, PointCloud, SceneError

CONFIGS = Path(__file__).resolve().parents[2] / 'configs'
GROWING = {'type': 'RegionGrowing', 'threshold': 0.9, 'max_edge': 0.25, 'min_region': 10}
UTM = np.array([448_263.4, 5_411_932.7, 312.9])  # m


class Scenes(SegmentationDataset):
    """Scenes that are given."""

    thing_classes = (1,)

    def __init__(self, *scenes: RawScene, **settings) -> None:
        super().__init__('train', classes=CLASSES, **settings)
        self.given = scenes

    def find_scenes(self) -> tuple[str, ...]:
        return tuple(f'scene{i}' for i in range(len(self.given)))

    def read_scene(self, index: int) -> RawScene:
        return self.given[index]


def keep(scene: RawScene, mask) -> RawScene:
    return RawScene(scene.cloud.select(mask), scene.semantic[mask], scene.instance[mask])


def label_maker(folder, source, oversegmenter=GROWING, **settings) -> SegmentationLabelMaker:
    made = SegmentationLabelMaker(
        store=folder / 'labels',
        cache=folder / 'geometry',
        source=source,
        descriptor={'type': 'AdaptedPFH', 'radius': 0.15, 'max_neighbors': 16},
        oversegmenter=oversegmenter,
        **settings,
    )
    return rounds.start(made)


def two_rounds(folder, source, **settings) -> SegmentationLabelMaker:
    """Round 0, and round 1 by a network that is right everywhere."""
    made = label_maker(folder, source, **settings)
    made.begin(1)
    for scene, index in made.index_of.items():
        truth = source.truth(index).semantic
        probabilities = np.full((len(truth), 3), 0.02, dtype=np.float32)
        probabilities[np.arange(len(truth)), np.maximum(truth, 0)] = 0.96
        made.refresh(1, scene, PointPrediction(probabilities, None))
    rounds.close(made, 1)
    return made


def model(**inputs) -> RM3DSegmentor:
    backbone = {'type': 'SparseUNet', 'voxel_size': 0.2, 'widths': [8, 16], 'blocks': 1}
    with DefaultScope.overwrite_default_scope(SCOPE):
        return RM3DSegmentor(
            backbone,
            3,
            inputs=inputs,
            instance_head={},
            losses=[{'type': 'WeakSupervision', 'balance': 'frequency'}, *segmentation_losses(instances=True)[1:]],
            thing_classes=[1],
        )


def batch_of(*items):
    """What a data loader hands to a model."""
    return pseudo_collate([pack_scene(item) for item in items])


def learn_and_predict(network, made, dataset_of):
    """One step and one prediction on the current labels, of classes and instances; all finite."""
    made.use(1)
    dataset = dataset_of(labels='store', label_store=made.store.root)
    network.set_label_statistics(made.statistics())
    batch = batch_of(*(dataset.raw(i) for i in range(len(dataset))))
    losses = network(**network.data_preprocessor(batch, True), mode='loss')
    sum(losses.values()).backward()
    assert all(torch.isfinite(value) for value in losses.values())
    assert all(torch.isfinite(p.grad).all() for p in network.parameters() if p.grad is not None)
    network.eval()
    samples = network(**network.data_preprocessor(batch, False), mode='predict')
    for sample in samples:
        points, found = len(sample.pred_point_probs), len(sample.pred_instance_labels)
        assert torch.isfinite(sample.pred_point_probs).all() and torch.isfinite(sample.pred_point_centers).all()
        assert sample.pred_point_centers.shape == (points, 3) and sample.pred_instance_masks.shape == (found, points)
        assert torch.isfinite(sample.pred_instance_scores).all() and set(sample.pred_instance_labels.tolist()) <= {1}
    return samples


def test_a_class_that_a_scene_or_all_scenes_lack(tmp_path):
    rooms = [make_scene(0), make_scene(1)]
    without_boxes = [keep(rooms[0], rooms[0].semantic != 1), keep(rooms[1], rooms[1].semantic != 2)]
    for number, scenes in enumerate([without_boxes, without_boxes[:1]]):
        dataset_of = partial(Scenes, *scenes)
        made = two_rounds(tmp_path / str(number), PointBudgetSource(dataset_of(), 'onept'))
        assert (made.store.read('scene0', 1).semantic != 1).all()
        assert made.class_counts.tolist() == ([2, 1, 1] if number == 0 else [1, 0, 1])
        summary = made.store.summary(1)
        assert summary['precision'] > 0.95 and summary['coverage'] > 0.9
        if number:
            assert summary['points']['box'] == {
                'pseudo': 0,
                'precision': None,
                'recall': None,
                'coverage': None,
                'offset_error': None,
            }
        learn_and_predict(model(), made, dataset_of)


def test_scenes_without_colour_are_labelled_by_shape_and_a_model_that_wants_colour_says_so(tmp_path):
    room = make_scene(0)
    plain = RawScene(PointCloud(room.cloud.xyz), room.semantic, room.instance)
    dataset_of = partial(Scenes, plain)
    made = two_rounds(tmp_path, PointBudgetSource(dataset_of(), '20pts'))
    assert made.store.summary(1)['precision'] > 0.95 and made.store.summary(1)['coverage'] > 0.9
    with pytest.raises(
        SceneError, match=r"points: 3 columns, but x, y, z and columns=\['rgb'\] make 6; set inputs.col"
    ):
        learn_and_predict(model(columns=['rgb']), made, dataset_of)
    learn_and_predict(model(columns=[]), made, dataset_of)
    steps = [
        TRANSFORMS.build({'type': f'{SCOPE}.{name}'}) for name in ('ColorAutoContrast', 'ColorJitter', 'AugmentedView')
    ]
    item = Scenes(plain, pipeline=steps)[0]
    np.testing.assert_array_equal(item['points'], room.cloud.xyz)


def test_coloured_and_colourless_scenes_in_one_batch_are_refused():
    room = make_scene(0)
    mixed = Scenes(room, RawScene(PointCloud(room.cloud.xyz), room.semantic, room.instance))
    with pytest.raises(SceneError, match='scenes of 3 and 6 columns in one batch; expected colour'):
        model().data_preprocessor(batch_of(mixed.raw(0), mixed.raw(1)), True)


class InOnePlace(LabelSource):
    """Twenty annotated points, all of the floor and next to each other."""

    classes, scene_ids, thing_classes = CLASSES, ('room',), (1,)

    def __init__(self) -> None:
        self.scene = make_scene(0)
        floor = np.flatnonzero(self.scene.semantic == 0)
        near = np.square(self.scene.cloud.xyz[floor] - [3.5, 2.5, 0]).sum(axis=1).argsort()
        self.points = floor[near[:20]]

    def load_cloud(self, index):
        return self.scene.cloud

    def annotated_labels(self, index):
        semantic = np.full(len(self.scene.semantic), -1)
        semantic[self.points] = 0
        return AnnotatedLabels(semantic, np.full(len(semantic), -1), Boxes3D.empty())

    def truth(self, index):
        return Scenes(self.scene).load_truth(index)


def test_all_labels_in_one_region(tmp_path):
    source = InOnePlace()
    made = two_rounds(tmp_path, source)
    first, second = made.store.read('room', 0), made.store.read('room', 1)
    regions = made.scenes.get('room').regions.labels
    assert set(first.semantic) == {-1, 0}  # nothing else is known
    assert set(regions[first.semantic == 0]) == set(regions[source.points])
    truth = source.scene.semantic
    assert set(second.semantic) >= {0, 1, 2}  # the network names the classes of the others
    assert (second.semantic == truth)[(second.semantic >= 0) & (truth >= 0)].mean() > 0.95


@pytest.mark.filterwarnings('ignore:.*cannot be described:UserWarning')
@pytest.mark.parametrize('count', [1, 2, 3])
def test_scenes_of_a_point_or_a_few(tmp_path, count):
    room = make_scene(0)
    tiny = keep(room, np.flatnonzero(room.semantic == 1)[:count])
    dataset_of = partial(Scenes, tiny, room)
    with pytest.warns(UserWarning, match=f'scene0: {count} of {count} points cannot be described by AdaptedPFH'):
        made = two_rounds(tmp_path, PointBudgetSource(dataset_of(), 'onept'))
    labels = made.store.read('scene0', 1)
    assert len(labels) == count and labels.point_is_annotated.sum() == 1
    assert set(labels.semantic) <= {-1, 1}
    samples = learn_and_predict(model(), made, dataset_of)
    assert samples[0].pred_point_probs.shape == (count, 3)


def test_a_scene_in_utm_coordinates_gets_the_labels_of_the_same_scene_at_the_origin(tmp_path):
    room = make_scene(0)
    far = RawScene(make_cloud(room.cloud.xyz + UTM, colors=room.cloud.colors), room.semantic, room.instance)
    assert np.abs(far.cloud.xyz).max() < 10
    np.testing.assert_allclose(far.cloud.xyz + far.cloud.origin, room.cloud.xyz + UTM, atol=1e-6)
    near, there = (
        two_rounds(tmp_path / name, PointBudgetSource(Scenes(scene), '20pts'))
        for name, scene in (('near', room), ('far', far))
    )
    for number in (0, 1):
        ours, theirs = near.store.read('scene0', number), there.store.read('scene0', number)
        np.testing.assert_array_equal(ours.point_is_annotated, theirs.point_is_annotated)
        assert (ours.semantic == theirs.semantic).mean() > 0.98
        assert near.store.summary(number)['precision'] == pytest.approx(
            there.store.summary(number)['precision'], abs=0.02
        )
    learn_and_predict(model(), there, partial(Scenes, far))


def colourless(scene: RawScene) -> RawScene:
    return scene._replace(cloud=PointCloud(scene.cloud.xyz))


def unlabelled(scene: RawScene) -> RawScene:
    nothing = np.full(len(scene.semantic), -1)
    return RawScene(scene.cloud, nothing, nothing)


def one_point(scene: RawScene) -> RawScene:
    return keep(scene, np.flatnonzero(scene.semantic == 1)[:1])


ROOM = make_scene(0)
EDGES = {
    'no colour': [colourless(ROOM)],
    'colour in one scene': [ROOM, colourless(make_scene(1))],
    'one point': [one_point(ROOM), ROOM],
    'one point without colour': [colourless(one_point(ROOM)), ROOM],
    'one class': [keep(ROOM, ROOM.semantic == 0)],
    'a scene without labels': [unlabelled(ROOM), make_scene(1)],
}
LEAVES = ['rm3d_sem_scannet_onept', 'rm3d_sem_semantickitti_onept', 'rm3d_sem_files_streets_clicks']


def config_of(leaf, folder):
    settings = {'cache_dir': str(folder / 'cache'), 'rounds': 2}
    return load_config(CONFIGS / f'{leaf}.py', folder / 'run', options=settings)


@pytest.mark.filterwarnings('ignore:.*cannot be described:UserWarning')
@pytest.mark.parametrize('leaf', LEAVES)
@pytest.mark.parametrize('edge', EDGES)
def test_the_rules_of_the_configs_bear_every_edge(tmp_path, edge, leaf):
    config = config_of(leaf, tmp_path)
    growing = dict(GROWING)
    if 'max_color_step' in config.oversegmenter:
        growing['max_color_step'] = config.oversegmenter.max_color_step
    if config.oversegmenter.type == 'GroundPatches':
        growing = {'type': 'GroundPatches', 'cell': config.oversegmenter.cell, 'rest': growing}
    source = PointBudgetSource(Scenes(*EDGES[edge]), 'onept')
    names = ('merge', 'propagation', 'region_prior', 'ground', 'self_training')
    rules = {name: config.to_dict()[name] for name in names}
    made = two_rounds(tmp_path, source, **rules, oversegmenter=growing)
    summary = made.store.summary(1)
    # One labelled region of each class is all that the prior of regions learns from, so some of its guesses are wrong.
    assert summary['coverage'] > 0.6 and summary['precision'] > 0.7


@pytest.mark.parametrize('leaf', LEAVES)
@pytest.mark.parametrize('edge', EDGES)
def test_the_training_transforms_of_the_configs_bear_every_edge(tmp_path, edge, leaf):
    steps = config_of(leaf, tmp_path).train_pipeline
    assert steps[-1].type == 'PackScene'
    for step in steps:
        step.update({name: value for name, value in (('max_points', 500), ('prob', 1.0)) if name in step})
    with DefaultScope.overwrite_default_scope(SCOPE):
        scenes = Scenes(*EDGES[edge], pipeline=steps[:-1])
    for index, scene in enumerate(EDGES[edge]):
        item = scenes[index]
        points = item['points']
        assert np.isfinite(points).all() and 1 <= len(points) <= 500
        assert len(item['point_index']) == len(points) and (item['point_index'] < len(scene.cloud)).all()
        assert all(np.isfinite(view.points).all() for view in item.get('views', ()))
