"""A descriptor of turned scenes is the descriptor of the turned cloud."""

import dataclasses
import zlib

import numpy as np
import pytest
from reference.rooms import make_room

from rm3d_plugin.descriptors import FPFH, SuperpointGraph, TurnedScene
from rm3d_plugin.ops.turns import random_turn
from rm3d_plugin.structures import PointCloud


@pytest.fixture(scope='module')
def room():
    xyz, _ = make_room(density=60, seed=0)
    return PointCloud(xyz, sensor=(1.0, 1.0, 1.5))


def test_it_describes_the_turned_cloud_of_each_scene(room):
    part = TurnedScene({'type': 'SuperpointGraph', 'k': 20}, seed=3).for_scene('a')
    turn = random_turn('so3', np.random.default_rng([3, zlib.crc32(b'a')]))
    moved = dataclasses.replace(room, xyz=(room.xyz @ turn.T).astype(np.float32), sensor=turn @ room.sensor)
    expected = SuperpointGraph(20).compute(moved).values
    np.testing.assert_allclose(part.compute(room).values, expected, atol=2e-3)
    as_scanned = SuperpointGraph(20).compute(room).values
    assert np.abs(part.compute(room).values[:, 3] - as_scanned[:, 3]).mean() > 0.1  # verticality
    np.testing.assert_allclose(part.compute(room).values[:, :3], as_scanned[:, :3], atol=2e-3)
    other = TurnedScene({'type': 'SuperpointGraph', 'k': 20}, seed=3).for_scene('b')
    assert not np.allclose(other.compute(room).values, part.compute(room).values, atol=1e-2)


def test_what_does_not_turn_stays(room):
    values = TurnedScene({'type': 'FPFH'}, kind='z').compute(room).values
    assert np.median(np.abs(values - FPFH().compute(room).values)) < 0.01


def test_its_name_tells_the_turn_and_the_base():
    parts = [
        TurnedScene({'type': 'FPFH', 'radius': r}, kind, s) for r in (0.1, 0.2) for kind in ('z', 'so3') for s in (0, 1)
    ]
    assert len({part.fingerprint() for part in parts}) == 8
    assert parts[0].for_scene('a').fingerprint() == parts[0].fingerprint()
    with pytest.raises(ValueError, match="kind: expected one of .*got 'x'"):
        TurnedScene({'type': 'FPFH'}, kind='x')
