import pytest
import torch

from rm3d_plugin.models.heads import SemanticHead, join_point_labels
from rm3d_plugin.structures import SceneError, SceneSample


def sample(semantic=None, instance=None, is_annotated=None):
    out = SceneSample(metainfo={'scene_id': 's'})
    for name, value in (
        ('pts_semantic_mask', semantic),
        ('pts_instance_mask', instance),
        ('pts_is_annotated', is_annotated),
    ):
        if value is not None:
            out.set_data({name: torch.tensor(value)})
    return out


def test_join_point_labels_numbers_instances_through_the_batch():
    samples = [sample([0, 1, 1, -1], [-1, 7, 3, 3], [True, False, True, True]), sample(), sample([2], [3])]
    got = join_point_labels(samples, torch.tensor([0, 4, 6, 7]), 3)
    assert got.semantic.tolist() == [0, 1, 1, -1, -1, -1, 2]
    assert got.instance.tolist() == [-1, 1, 0, 0, -1, -1, 2]
    assert got.instance_scene.tolist() == [0, 0, 2]
    assert got.is_annotated.tolist() == [True, False, True, False, False, False, True]


def test_join_point_labels_tells_what_does_not_fit():
    with pytest.raises(SceneError, match='s: pts_semantic_mask: expected 3 values, one a point'):
        join_point_labels([sample([0, 1])], torch.tensor([0, 3]), 3)
    with pytest.raises(SceneError, match='expected -1..1, got class 2'):
        join_point_labels([sample([0, 2])], torch.tensor([0, 2]), 2)
    assert join_point_labels([sample([])], torch.tensor([0, 0]), 2).semantic.tolist() == []


def test_class_counts_are_kept_in_the_state():
    head = SemanticHead(4, 3)
    head.set_class_counts(torch.tensor([1.0, 2, 3]))
    other = SemanticHead(4, 3)
    other.load_state_dict(head.state_dict())
    assert other.class_counts.tolist() == [1.0, 2.0, 3.0]
    with pytest.raises(ValueError, match='expected 3 class counts'):
        head.set_class_counts(torch.ones(4))
