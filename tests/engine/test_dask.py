"""Preparing scenes on a cluster: joblib's dask backend, here with two local workers."""

import numpy as np
import pytest
from runs import tiny_runs

distributed = pytest.importorskip('distributed')


def _prepare(world, cache):
    import joblib
    from mmengine.registry import init_default_scope

    from rm3d_plugin.engine.config import load_config
    from rm3d_plugin.engine.run import prepare
    from rm3d_plugin.registry import SCOPE

    settings = tiny_runs.options(world) | {'cache_dir': str(cache / 'dask')}
    config = load_config(tiny_runs.CONFIG, cache / 'run', demo=True, options=settings)
    init_default_scope(SCOPE)
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        with distributed.Client(cluster) as client, joblib.parallel_config('dask', wait_for_workers_timeout=60):
            prepare(config, jobs=2)
            told = client.run(lambda: True)
    print(f'{len(told)} workers')
    config = load_config(
        tiny_runs.CONFIG, cache / 'run', demo=True, options=settings | {'cache_dir': str(cache / 'alone')}
    )
    prepare(config, jobs=1)


@pytest.mark.slow
def test_two_dask_workers_fill_the_cache_as_one_process_does(tmp_path):
    world = tiny_runs.make_world(tmp_path / 'world')
    code, log = tiny_runs.run(tmp_path / 'log.txt', _prepare, world, tmp_path)
    assert code == 0, log
    assert '2 workers' in log and 'preparing geometry, 2 processes' in log
    dask, alone = (sorted((tmp_path / name).rglob('*.npz')) for name in ('dask', 'alone'))
    assert len(dask) == 3 and [p.name for p in dask] == [p.name for p in alone]
    for one, two in zip(dask, alone, strict=True):
        first, second = np.load(one), np.load(two)
        assert first.files == second.files
        assert all(np.array_equal(first[name], second[name], equal_nan=first[name].dtype.kind == 'f') for name in first)
