import pytest
import torch

from rm3d_plugin.models.segmentors import PointInputs, point_inputs


def offsets(*ends):
    return torch.tensor([0, *ends])


def test_features_by_hand():
    points = torch.tensor([[0.0, 0, 0, 0.5, 0, 1], [10, 0, 3, 1, 1, 1], [-10, 30, 1.5, 0, 0, 0]])
    got = point_inputs(points, offsets(3), PointInputs())
    # median place (0, 0), floor 0: 10 / (10 + 10), 30 / 40; heights 0, 1, 1/2
    assert got.tolist() == [[0, -1, 1, 0, 0, 0, 1], [1, 1, 1, 1, 0.5, 0, 1], [-1, -1, -1, 0.5, -0.5, 0.75, 1]]
    assert PointInputs().channels == got.shape[1] == 7


@pytest.mark.parametrize(
    ('settings', 'columns', 'channels'),
    [
        (PointInputs(columns=()), 3, 4),
        (PointInputs(columns=('intensity',)), 4, 5),
        (PointInputs(columns=('intensity', 'rgb')), 7, 8),
        (PointInputs(columns=('intensity', 'rgb'), use=('rgb',)), 7, 7),
        (PointInputs(columns=('rgb',), use=(), height=False, coordinates=False), 6, 1),
        (PointInputs(coordinates=False), 6, 5),
        (PointInputs(columns=('shape', 'clearance'), coordinates=False), 23, 22),
    ],
)
def test_channels_are_counted(settings, columns, channels):
    points = torch.rand(20, columns)
    assert settings.point_columns == columns
    assert point_inputs(points, offsets(20), settings).shape == (20, settings.channels) == (20, channels)


def test_unused_colour_is_not_seen():
    settings = PointInputs(columns=('intensity', 'rgb'), use=('intensity',))
    points = torch.rand(10, 7)
    other = points.clone()
    other[:, 4:] = 0
    assert torch.equal(point_inputs(points, offsets(10), settings), point_inputs(other, offsets(10), settings))


def test_scenes_do_not_see_each_other_and_moving_a_scene_changes_nothing():
    points = torch.rand(200, 6) * 4
    moved = points + torch.tensor([64.0, -128, 32, 0, 0, 0])
    alone = point_inputs(points, offsets(200), PointInputs())
    both = point_inputs(torch.cat([moved, points]), offsets(200, 200, 400), PointInputs())
    assert torch.equal(both[200:], alone)
    torch.testing.assert_close(both[:200], alone, atol=1e-5, rtol=0)


def test_halls_and_stray_points_stay_in_range():
    points = torch.rand(1000, 6, generator=torch.Generator().manual_seed(0)) * torch.tensor([100.0, 300, 20, 1, 1, 1])
    points[0, :3] = torch.tensor([5e4, -5e4, -5e4])
    got = point_inputs(points, offsets(1000), PointInputs())
    assert got.abs().max() <= 2 and torch.isfinite(got).all()
    clean = point_inputs(points[1:], offsets(999), PointInputs())
    torch.testing.assert_close(got[1:], clean, atol=0.02, rtol=0)  # one stray point moves nothing


def test_bad_input_is_told():
    with pytest.raises(ValueError, match=r"4 columns, but x, y, z and columns=\['rgb'\] make 6"):
        point_inputs(torch.zeros(2, 4), offsets(2), PointInputs())
    with pytest.raises(ValueError, match='intensity before rgb'):
        PointInputs(columns=('rgb', 'intensity'))
    with pytest.raises(ValueError, match='does not have'):
        PointInputs(columns=('rgb',), use=('intensity',))
    with pytest.raises(ValueError, match='lengths > 0'):
        PointInputs(extent=0.0)
