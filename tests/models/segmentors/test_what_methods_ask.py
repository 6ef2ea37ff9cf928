"""What a segmentor does for compared methods: features beside predictions, probabilities that are refined."""

import numpy as np
import torch
from coloured_boxes import make_room, segmentor_config
from mmengine.dataset import pseudo_collate

from rm3d_plugin.engine.scene_prediction import scene_prediction
from rm3d_plugin.registry import MODELS


@MODELS.register_module(name='FirstClass', force=True)
class FirstClass:
    """Says the first class of every point above the middle."""

    def __call__(self, points, probs):
        above = points[:, 2] > points[:, 2].median()
        return torch.where(above[:, None], torch.eye(probs.shape[1])[0], probs)


def predicted(seed=0, asked=False, features=False, **changes):
    torch.manual_seed(0)
    model = MODELS.build(segmentor_config(**changes)).eval()
    model.predict_points, model.predict_features = asked, features
    batch = model.data_preprocessor(pseudo_collate([make_room(seed)]))
    (sample,) = model(**batch, mode='predict')
    return model, batch['inputs'], sample


def test_features_lie_beside_the_probabilities_where_they_are_asked_for():
    model, inputs, sample = predicted(asked=True, features=True)
    with torch.no_grad():
        said = model(inputs, mode='tensor')
    assert torch.allclose(sample.pred_point_features, said.features, atol=1e-5)
    assert torch.allclose(sample.pred_point_probs, said.logits.softmax(1), atol=1e-5)
    assert torch.allclose(sample.pred_point_centers, inputs['points'][:, :3] + said.offsets, atol=1e-4)
    _, prediction = scene_prediction(sample)
    np.testing.assert_array_equal(prediction.features, sample.pred_point_features.numpy())
    for asked in ({'asked': True}, {'features': True}):
        assert 'pred_point_features' not in predicted(**asked)[2]


def test_turned_views_leave_features_alone():
    turned = {'inference': {'first_angle': 90.0}}
    model, inputs, sample = predicted(asked=True, features=True, **turned)
    points = inputs['points'].clone()
    points[:, :2] = torch.stack([-points[:, 1], points[:, 0]], dim=1)
    with torch.no_grad():
        said = model({**inputs, 'points': points}, mode='tensor')
    assert torch.allclose(sample.pred_point_features, said.features, atol=1e-4)


def test_probabilities_are_refined_at_test_time_and_not_for_labels():
    plain, refined = (predicted(**changes)[2].pred_point_probs for changes in ({}, {'refine': {'type': 'FirstClass'}}))
    _, inputs, labels = predicted(asked=True, refine={'type': 'FirstClass'})
    z = inputs['points'][:, 2]
    above = z > z.median()
    assert (refined[above, 0] == 1).all() and torch.equal(refined[~above], plain[~above])
    assert torch.equal(labels.pred_point_probs, plain)
