"""Tiles: each site in one core, all that the reach asks for around it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rm3d_plugin.descriptors.learned.tiles import describe_tiles, make_blocks, make_tiles


def places_of(seed, count=400):
    return np.random.default_rng(seed).uniform(0, 40, (count, 3)).astype(np.float32)


def tiles_of(kind, places, reach):
    return list(make_tiles(places, reach, 60) if kind == 'tiles' else make_blocks(places, reach, 16.0))


@given(st.integers(0, 1000), st.floats(0.0, 20.0), st.sampled_from(['tiles', 'blocks']))
@settings(deadline=None, max_examples=20)
def test_each_site_has_one_core_and_its_surroundings(seed, reach, kind):
    places = places_of(seed)
    tiles = tiles_of(kind, places, reach)
    cores = np.concatenate([tile.rows[tile.core] for tile in tiles])
    assert np.array_equal(np.sort(cores), np.arange(len(places)))
    for tile in tiles:
        assert (np.diff(tile.rows) > 0).all()
        for row in tile.rows[tile.core][:3]:
            near = np.abs(places - places[row]).max(axis=1) <= reach - 1e-3
            assert np.isin(np.flatnonzero(near), tile.rows).all()


def test_blocks_are_those_of_a_fixed_grid():
    places = np.array([[1.0, 1, 1], [15.0, 1, 1], [17.0, 1, 1], [18.0, 1, 40]], dtype=np.float32)
    found = [(tile.rows.tolist(), tile.core.tolist()) for tile in make_blocks(places, 2.0, 16.0)]
    assert found == [([0, 1, 2], [True, True, False]), ([1, 2], [False, True]), ([3], [True])]


@pytest.mark.parametrize('kind', ['tiles', 'blocks'])
def test_what_is_said_of_cores_is_put_together(kind):
    places = places_of(1)
    out = describe_tiles(tiles_of(kind, places, 3.0), len(places), lambda rows: rows[:, None] * np.ones((1, 2)))
    assert np.array_equal(out, np.repeat(np.arange(400.0), 2).reshape(400, 2)) and out.dtype == np.float32
    assert describe_tiles(tiles_of(kind, places[:0], 3.0), 0, lambda rows: rows[:, None]).shape[0] == 0
