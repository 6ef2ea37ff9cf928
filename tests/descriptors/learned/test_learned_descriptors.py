"""Learned descriptors: the same values whatever tiles, order and place; masks; checkpoints that are refused."""

import hashlib
import json

import numpy as np
import pytest
import torch

from rm3d_plugin.descriptors.learned.weights_file import read_weights, write_weights
from rm3d_plugin.registry import DESCRIPTORS, MODELS
from rm3d_plugin.storage import write_npz
from rm3d_plugin.structures import PointCloud
from rm3d_plugin.user_error import ConfigError

BACKBONE = {'type': 'SparseUNet', 'voxel_size': 1.0, 'widths': [8, 12], 'blocks': 1, 'map_cache': 0}
MODEL = {
    'Contrastive': {'type': 'DescriptorNetwork', 'backbone': BACKBONE, 'channels': 8, 'in_channels': 40},
    'Predator': {'type': 'PredatorNetwork', 'backbone': BACKBONE, 'channels': 8, 'in_channels': 40}
    | {'attention': {'channels': 8}, 'block': 24, 'margin': 6},
    'PointSIFT': {'type': 'DescriptorNetwork', 'channels': 8, 'in_channels': 40}
    | {'backbone': {'type': 'PointSIFTBackbone', 'channels': 8, 'radii': [2.0, 4.0]}},
    'Semantic': {'type': 'DescriptorNetwork', 'backbone': BACKBONE, 'channels': 8, 'in_channels': 44},
    'SupervisedSuperpoint': {'type': 'DescriptorNetwork', 'backbone': {'type': 'LocalCloudEmbedder'}, 'channels': 4},
}
NAMES = sorted(MODEL)


@pytest.fixture(scope='module')
def files(tmp_path_factory):
    """A small untrained network of each kind, as a file."""
    folder, found = tmp_path_factory.mktemp('weights'), {}
    for name, model in MODEL.items():
        torch.manual_seed(1)
        network = MODELS.build(model)
        found[name] = write_weights(folder / f'{name}.npz', {**model, 'losses': [{'type': 'X'}]}, network.state_dict())
    return found


@pytest.fixture(scope='module')
def cloud():
    """Two walls and a floor, 10 cm between points, 6 m wide."""
    rng = np.random.default_rng(0)
    xyz = rng.uniform(0, 6, (9000, 3))
    xyz[np.arange(9000), rng.integers(0, 3, 9000)] = 0
    return PointCloud(xyz.astype(np.float32))


def build(name, files, **settings):
    return DESCRIPTORS.build({'type': name, 'checkpoint': str(files[name]), **settings})


@pytest.mark.parametrize('name', NAMES)
def test_values_do_not_depend_on_tiles_order_place_or_chance(name, files, cloud):
    whole = build(name, files, max_sites=10**6).compute(cloud)
    assert whole.valid.mean() > 0.99 and np.isfinite(whole.values).all()
    np.testing.assert_allclose(np.linalg.norm(whole.values[whole.valid], axis=1), 1, atol=1e-5)
    order = np.random.default_rng(1).permutation(len(cloud))
    cases = {
        'tiles': (build(name, files, max_sites=500).compute(cloud).values, 1e-5),
        'again': (build(name, files).compute(cloud).values, 1e-5),
        'order': (build(name, files).compute(cloud.select(order)).values[np.argsort(order)], 1e-4),
        'place': (build(name, files).compute(PointCloud(cloud.xyz + np.float32([8, -16, 4]))).values, 1e-3),
    }
    for case, (values, tolerance) in cases.items():
        worst = np.abs(values - whole.values).max(axis=1)
        assert np.quantile(worst, 0.99) <= tolerance, case
        assert case == 'place' or worst.max() <= tolerance, case  # rounding moves single points over a border


@pytest.mark.parametrize('name', NAMES)
def test_what_cannot_be_described_is_masked(name, files, cloud):
    far = np.concatenate([cloud.xyz, [[400.0, 0.0, 0.0]]]).astype(np.float32)
    found = build(name, files).compute(PointCloud(far))
    assert not found.valid[-1] and not found.values[-1].any() and found.valid[:-1].mean() > 0.99
    for count in (0, 1, 5):
        few = build(name, files).compute(PointCloud(cloud.xyz[:count]))
        assert len(few) == count and not few.valid.any()
    assert not build(name, files).compute(PointCloud(np.ones((50, 3), dtype=np.float32))).valid.any()


def test_the_unit_follows_the_scan(files, cloud):
    part = build('Contrastive', files)
    small, large = part.compute(cloud), part.compute(PointCloud(cloud.xyz * np.float32(4)))
    same = np.abs(small.values - large.values).max(axis=1) < 1e-3
    assert same.mean() > 0.99, 'streets are rooms seen from afar'
    assert np.array_equal(build('Contrastive', files, voxel_size=0.3).sites(cloud).unit, 0.3)


def test_fingerprints_see_weights_and_not_their_place(files, tmp_path):
    first = build('Contrastive', files)
    moved = tmp_path / 'elsewhere.npz'
    moved.write_bytes(files['Contrastive'].read_bytes())
    assert first.fingerprint() == build('Contrastive', {'Contrastive': moved}, max_sites=7).fingerprint()
    assert first.fingerprint() != build('Contrastive', files, voxel_size=0.2).fingerprint()
    arrays = {name: np.array(value) for name, value in first.weights.items()}
    arrays['projection.bias'][0] += 1
    other = {name: torch.from_numpy(value) for name, value in arrays.items()}
    write_weights(tmp_path / 'other.npz', MODEL['Contrastive'], other)
    assert first.fingerprint() != build('Contrastive', {'Contrastive': tmp_path / 'other.npz'}).fingerprint()


def checkpoint(path, model, **more):
    """A file as a training leaves it."""
    torch.manual_seed(1)
    state = MODELS.build(model).state_dict()
    torch.save({'state_dict': state, 'meta': {'config_json': json.dumps({'model': model})}, **more}, path)
    return path


def test_a_checkpoint_of_training_says_the_same_but_for_half_precision(files, cloud, tmp_path):
    path = checkpoint(tmp_path / 'epoch_1.pth', {**MODEL['Contrastive'], 'losses': []})
    full = build('Contrastive', {'Contrastive': path}).compute(cloud)
    half = build('Contrastive', files).compute(cloud)
    assert np.abs(full.values - half.values).max() < 2e-2
    assert (full.values * half.values).sum(axis=1)[full.valid].min() > 0.999


def test_checkpoints_that_are_refused(files, tmp_path):
    def refused(content, match, name='bad.npz'):
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(ConfigError, match=match):
            build('Contrastive', {'Contrastive': path})

    with pytest.raises(ConfigError, match='no such checkpoint'):
        build('Contrastive', {'Contrastive': tmp_path / 'none.npz'})
    good = files['Contrastive'].read_bytes()
    refused(good[: len(good) // 2], 'cut off or altered')
    refused(b'not an archive', 'cut off or altered')
    refused(b'not a checkpoint', 'not a checkpoint', 'bad.pth')
    flipped = bytearray(good)
    flipped[len(good) // 2] ^= 0xFF
    refused(bytes(flipped), 'bad.npz')
    with pytest.raises(ConfigError, match='Contrastive expected a DescriptorNetwork'):
        build('Contrastive', {'Contrastive': files['Predator']})
    with pytest.raises(ConfigError, match='reads 44 inputs of a site; Contrastive expected 40'):
        build('Contrastive', {'Contrastive': files['Semantic']})


def rewritten(path, source, **changes):
    """An archive with some of its arrays changed."""
    trained = read_weights(source)
    model = json.dumps({**trained.model, **changes.pop('model', {})}).encode()
    return write_npz(path, {'config': np.frombuffer(model, dtype=np.uint8), **trained.arrays, **changes})


@pytest.mark.parametrize(
    ('changes', 'match'),
    [
        ({'model': {'type': 'os.system'}}, 'is no part of rm3d_plugin'),
        ({'model': {'backbone': {**BACKBONE, 'type': 'Pretrained'}}}, 'is no part of rm3d_plugin'),
        ({'model': {'channels': 10**9}}, 'larger than the network'),
        ({'projection.bias': np.full(8, np.nan, dtype=np.float32)}, 'NaN or infinite'),
        ({'projection.bias': np.zeros(9, dtype=np.float32)}, 'do not fit the model'),
    ],
)
def test_archives_of_others_are_refused_before_they_run(changes, match, files, tmp_path):
    path = rewritten(tmp_path / 'foreign.npz', files['Contrastive'], **changes)
    with pytest.raises(ConfigError, match=match):
        build('Contrastive', {'Contrastive': path}).compute(PointCloud(np.random.default_rng(0).random((200, 3))))


def test_arguments_that_make_no_sense(files):
    for settings in ({'voxel_size': 0.0}, {'max_sites': 0}):
        with pytest.raises(ValueError, match=next(iter(settings))):
            build('Contrastive', files, **settings)


SHIPPED = [name for name in NAMES if DESCRIPTORS.get(name).shipped().is_file()]


@pytest.mark.parametrize('name', SHIPPED)
def test_weights_of_the_package_are_small_and_have_a_card(name):
    path = DESCRIPTORS.get(name).shipped()
    content = path.read_bytes()
    card = path.with_suffix('.md').read_text(encoding='utf-8')
    assert len(content) < 2e6 and hashlib.sha256(content).hexdigest() in card and 'rm3d train' in card


@pytest.mark.parametrize('name', [name for name in SHIPPED if name != 'SupervisedSuperpoint'])  # it knows borders alone
def test_the_weights_of_the_package_know_a_turned_scan_again(name, cloud):
    part = DESCRIPTORS.build({'type': name})
    free = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    upright = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    turn = upright if name == 'Semantic' else free  # it knows what is up
    first, second = part.compute(cloud), part.compute(PointCloud((cloud.xyz @ turn.T).astype(np.float32)))
    alike = (first.values * second.values).sum(axis=1)
    others = (first.values * second.values[::-1]).sum(axis=1)
    assert alike.mean() > others.mean() + 0.1, 'a point is more like itself than like another'
