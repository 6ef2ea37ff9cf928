"""Clusters of several scenes: annotated objects of one tell what those of another are like."""

from types import SimpleNamespace

import numpy as np
import pytest

from rm3d_plugin.labeling import cluster_knowledge as module
from rm3d_plugin.labeling.cluster_knowledge import ClusterKnowledge
from rm3d_plugin.ops.ground import segment_ground
from rm3d_plugin.pseudo_labels import AnnotatedLabels
from rm3d_plugin.registry import DESCRIPTORS
from rm3d_plugin.structures import Boxes3D, Descriptors, PointCloud
from rm3d_plugin.structures.point_cloud import SceneError

SIZES = np.array([[4.0, 2.0, 1.5], [0.8, 0.6, 1.8]])
CARS, PEOPLE, WALLS = (8.0, 18.0), (13.0, 28.0), (23.0,)


def scene(seed):
    """A floor with two cars, two people and a wall on it."""
    rng = np.random.default_rng(seed)
    floor = np.c_[rng.uniform(0, 35, 4000), rng.uniform(-6, 6, 4000), rng.normal(0, 0.01, 4000)]
    parts = [floor]
    kinds = ((CARS, (4.0, 2.0, 1.5), 1500), (PEOPLE, (0.6, 0.5, 1.75), 150), (WALLS, (0.2, 5, 1.6), 900))
    for places, size, count in kinds:
        for x in places:
            jitter = rng.uniform(-0.5, 0.5)
            middle = [x + jitter, 0.0, 0.0]
            parts.append(middle + rng.uniform([-0.5, -0.5, 0.02], [0.5, 0.5, 1.0], size=(count, 3)) * size)
    return PointCloud(np.concatenate(parts), sensor=(0.0, 0.0, 1.7))


CLOUDS = {f's{seed}': scene(seed) for seed in range(4)}
SCENES = SimpleNamespace(get=lambda scene_id: SimpleNamespace(cloud=CLOUDS[scene_id]))


def annotated(scene_id):
    """Both people and both cars of the first two scenes; the box of one person is in an empty place."""
    n, shown = len(CLOUDS[scene_id]), scene_id in ('s0', 's1')
    rows = [[x, 0, 0.75, 5.0, 2.2, 1.6, 0.0] for x in CARS] + [[x, 0, 0.9, 1.8, 0.7, 1.9, 0.0] for x in PEOPLE]
    if scene_id == 's1':
        rows[3][1] = 50.0
    boxes = Boxes3D(np.array(rows), np.array([0, 0, 1, 1])) if shown else Boxes3D.empty()
    return AnnotatedLabels(np.full(n, -1), np.full(n, -1), boxes)


def knowledge():
    return ClusterKnowledge(list(CLOUDS), SCENES, annotated, SIZES)


def test_objects_of_other_scenes_are_like_the_annotated_ones():
    told = knowledge()
    for scene_id, cloud in CLOUDS.items():
        got = told.of(scene_id, segment_ground(cloud.xyz))
        middle = np.array([cloud.xyz[got.point == c, 0].mean() for c in range(len(got.likeness))])
        by_place = {place: got.likeness[np.abs(middle - place).argmin()] for place in CARS + PEOPLE + WALLS}
        for place in CARS:
            assert by_place[place][0] > 0.3 > by_place[place][1]
        for place in PEOPLE:
            assert by_place[place][1] > 0.3 > by_place[place][0]
        assert by_place[WALLS[0]].max() < 0.3


def test_annotated_objects_are_left_out_of_their_own_likeness():
    told = knowledge()
    first, second, third = (told.of(s, segment_ground(CLOUDS[s].xyz)).annotated for s in ('s0', 's1', 's2'))
    assert len(third) == 0 and second[3] == 0.0  # a box without points is like nothing
    assert np.median(np.r_[first[:2], second[:2]]) == pytest.approx(1.0)
    assert np.median(np.r_[first[2:], second[2]]) == pytest.approx(1.0)


def test_so_many_scenes_are_looked_at(monkeypatch):
    monkeypatch.setattr(module, 'SCENES', 1)
    asked = []

    def get(scene_id):
        asked.append(scene_id)
        return SCENES.get(scene_id)

    told = ClusterKnowledge(list(CLOUDS), SimpleNamespace(get=get), annotated, SIZES)
    assert len(told.of('s2', segment_ground(CLOUDS['s2'].xyz)).annotated) == 0
    assert set(asked) == {'s0', 's2'}  # one with boxes, one without
    others = told.of('s1', segment_ground(CLOUDS['s1'].xyz)).annotated  # its objects were not learnt from
    assert (others[:3] > 0.2).all() and others[3] == 0.0


def test_objects_of_a_class_that_was_not_learnt_are_like_nothing_that_is_known(monkeypatch):
    monkeypatch.setattr(module, 'SCENES', 1)

    def cars_first(scene_id):
        given = annotated(scene_id)
        kept = given.boxes.labels == 0 if scene_id == 's0' else given.boxes.labels >= 0
        return AnnotatedLabels(given.semantic, given.instance, given.boxes.select(kept))

    told = ClusterKnowledge(list(CLOUDS), SCENES, cars_first, SIZES)
    others = told.of('s1', segment_ground(CLOUDS['s1'].xyz))
    assert not told.of_every_class and np.isnan(others.likeness[:, 1]).all()
    assert (others.annotated[:2] > 0).all() and others.annotated[2:].tolist() == [0.0, 0.0]


def test_scenes_with_and_without_intensity_are_told_apart():
    clouds = CLOUDS | {'s3': PointCloud(CLOUDS['s3'].xyz, intensity=np.ones(len(CLOUDS['s3'])))}
    scenes = SimpleNamespace(get=lambda scene_id: SimpleNamespace(cloud=clouds[scene_id]))
    told = ClusterKnowledge(list(clouds), scenes, annotated, SIZES)
    with pytest.raises(SceneError, match=r's3: expected intensity and colours as in s2'):
        told.of('s0', segment_ground(clouds['s0'].xyz))


def test_without_boxes_nothing_is_like_anything():
    told = ClusterKnowledge(['s2', 's3'], SCENES, annotated, SIZES)
    assert np.isnan(told.of('s2', segment_ground(CLOUDS['s2'].xyz)).likeness).all()
    unknown = ClusterKnowledge(['s2', 's3'], SCENES, annotated, np.full((2, 3), np.nan))
    assert len(unknown.of('s2', segment_ground(CLOUDS['s2'].xyz)).likeness) == 0


class _Told:
    """A descriptor that knows what each point is of: car, person, anything else; of a wall it says nothing."""

    asked = 0

    def compute(self, cloud):
        _Told.asked += 1
        x, high = cloud.xyz[:, 0], cloud.xyz[:, 2] > 0.03
        kinds = [np.abs(x[:, None] - places).min(axis=1) < wide for places, wide in ((CARS, 3.0), (PEOPLE, 1.0))]
        wall = np.abs(x - WALLS[0]) < 1.0
        values = np.column_stack([kind & high for kind in kinds]).astype(np.float32)
        values[wall] = 0.0
        return Descriptors(values, ~wall)


def test_a_descriptor_tells_what_clusters_look_like_beside_their_shapes(monkeypatch):
    monkeypatch.setattr(DESCRIPTORS, 'build', lambda config: _Told())
    told = ClusterKnowledge(list(CLOUDS), SCENES, annotated, SIZES, {'type': 'any'})
    shaped = knowledge()
    for scene_id, cloud in CLOUDS.items():
        ground = segment_ground(cloud.xyz)
        got, without = told.of(scene_id, ground), shaped.of(scene_id, ground)
        assert np.array_equal(got.point, without.point)
        middle = np.array([cloud.xyz[got.point == c, 0].mean() for c in range(len(got.likeness))])
        walls = np.abs(middle - WALLS[0]) < 1.0
        assert np.array_equal(got.likeness[walls], without.likeness[walls])  # of these shapes alone tell
        looks = 2.0 * got.likeness - without.likeness  # the mean of both counts
        for places, own in ((CARS, 0), (PEOPLE, 1)):
            for place in places:
                row = looks[np.abs(middle - place).argmin()]
                assert row[own] > 0.5 > row[1 - own]
    told.of('s0', segment_ground(CLOUDS['s0'].xyz))
    assert _Told.asked == len(CLOUDS)  # each scene is described once
    assert np.median(told.of('s0', segment_ground(CLOUDS['s0'].xyz)).annotated[:2]) == pytest.approx(1.0, abs=0.3)


class _Mute(_Told):
    """Of cars it says nothing."""

    def compute(self, cloud):
        told = super().compute(cloud)
        near = np.abs(cloud.xyz[:, 0, None] - CARS).min(axis=1) < 3.5
        return Descriptors(np.where(near[:, None], 0.0, told.source).astype(np.float32), told.valid & ~near)


def test_where_a_descriptor_says_nothing_of_a_class_shapes_alone_tell(monkeypatch):
    monkeypatch.setattr(DESCRIPTORS, 'build', lambda config: _Mute())
    told, shaped = ClusterKnowledge(list(CLOUDS), SCENES, annotated, SIZES, {'type': 'any'}), knowledge()
    ground = segment_ground(CLOUDS['s0'].xyz)
    got, without = told.of('s0', ground), shaped.of('s0', ground)
    assert told.of_every_class and np.array_equal(got.likeness[:, 0], without.likeness[:, 0])
    assert got.annotated[:2].tolist() == without.annotated[:2].tolist()
