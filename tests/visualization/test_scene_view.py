"""Scenes packed into a page: what the script unpacks is what was packed."""

import base64
import json
import re
import shutil
import subprocess

import numpy as np
import pytest

from rm3d_plugin.visualization import Layer, RunReport, SceneView, pack_views, render_report
from rm3d_plugin.visualization.palette import class_color
from rm3d_plugin.visualization.scene_view import NO_CLASS, NO_NUMBER, pack_view, shown_points, view_block
from rm3d_plugin.visualization.scene_view_script import SCRIPT

RNG = np.random.default_rng(0)
CLASSES = ('wall', 'a </script> class')


def decoded(text, dtype):
    return np.frombuffer(base64.b64decode(text), dtype)


def a_view(points=1000, marked=None, shift=0.0):
    rng = np.random.default_rng(1)
    layers = [
        Layer('colour', 'rgb', rng.uniform(size=(points, 3))),
        Layer('regions', 'number', rng.integers(-1, 300, points)),
        Layer('prediction', 'class', rng.integers(-1, 2, points), 'prediction'),
        Layer('truth', 'class', rng.integers(-1, 2, points), 'truth'),
    ]
    return SceneView('a scene', rng.uniform(-4, 9, (points, 3)) + shift, layers, marked)


def test_every_array_comes_back():
    view = a_view(shift=1000.0)
    packed = pack_view(view)
    assert (packed['title'], packed['count'], packed['total']) == ('a scene', 1000, 1000)
    xyz = np.array(packed['low']) + np.array(packed['step']) * decoded(packed['xyz'], '<u2').reshape(-1, 3)
    np.testing.assert_allclose(xyz, view.xyz, atol=13 / 65535)  # half a step of a 13 m wide scene, twice
    color, regions, prediction, truth = packed['layers']
    np.testing.assert_allclose(decoded(color['data'], 'u1').reshape(-1, 3) / 255, view.layers[0].values, atol=0.5 / 255)
    found = decoded(regions['data'], '<u2').astype(int)
    np.testing.assert_array_equal(np.where(found == NO_NUMBER, -1, found), view.layers[1].values)
    for layer, original in ((prediction, view.layers[2]), (truth, view.layers[3])):
        classes = decoded(layer['data'], 'u1').astype(int)
        np.testing.assert_array_equal(np.where(classes == NO_CLASS, -1, classes), original.values)
        assert (layer['kind'], layer['role']) == ('class', original.role)
    assert len(decoded(packed['marked'], '<u4')) == 0


def test_thinning_keeps_what_is_marked():
    view = a_view(1000, marked=np.array([999, 3, 7]))
    rows = shown_points(view, 100)
    assert set(range(0, 1000, 10)) <= set(rows) and {3, 7, 999} <= set(rows) and len(rows) == 103
    packed = pack_view(view, 100)
    assert packed['count'] == 103 and packed['total'] == 1000
    np.testing.assert_array_equal(rows[decoded(packed['marked'], '<u4')], [3, 7, 999])
    regions = decoded(packed['layers'][1]['data'], '<u2').astype(int)
    np.testing.assert_array_equal(np.where(regions == NO_NUMBER, -1, regions), view.layers[1].values[rows])


@pytest.mark.parametrize('points', [0, 1, 2])
def test_few_points(points):
    packed = pack_view(a_view(points))
    assert packed['count'] == points and len(decoded(packed['xyz'], '<u2')) == 3 * points
    assert all(np.isfinite(packed['low'])) and min(packed['step']) > 0
    view_block(pack_views([a_view(points)], CLASSES))


def test_the_page_stays_below_its_limit():
    views = [a_view(5000), a_view(3000)]
    limit = 60_000
    packed = pack_views(views, CLASSES, max_bytes=limit)
    data = sum(len(s['xyz']) + sum(len(layer['data']) for layer in s['layers']) for s in packed['scenes'])
    assert 0.5 * limit < data <= limit
    assert all(s['count'] < s['total'] for s in packed['scenes'])
    assert [s['count'] for s in pack_views(views, CLASSES)['scenes']] == [5000, 3000]
    assert [s['count'] for s in pack_views(views, CLASSES, max_points=1000)['scenes']] == [1000, 1000]


def test_what_cannot_be_shown_is_named():
    xyz = np.zeros((2, 3))
    with pytest.raises(ValueError, match="'s': expected at least one layer"):
        SceneView('s', xyz, [])
    with pytest.raises(ValueError, match=r"layer 'truth': expected shape \(2,\), got \(3,\)"):
        SceneView('s', xyz, [Layer('truth', 'class', np.zeros(3, int))])
    with pytest.raises(ValueError, match="layer 'truth': class 255, but at most 255"):
        SceneView('s', xyz, [Layer('truth', 'class', np.array([0, 255]))])


def test_the_page_holds_the_data_and_needs_no_network():
    packed = pack_views([a_view()], CLASSES, cut=0.85)
    page = render_report(RunReport('t', views=packed))
    assert 'Scenes to turn' in page
    text = re.search(r'<script type="application/json" id="view-data">(.*?)</script>', page, re.DOTALL)[1]
    assert json.loads(text) == packed and json.loads(text)['cut'] == 0.85
    assert packed['classes'] == [{'name': n, 'color': class_color(c)} for c, n in enumerate(CLASSES)]
    rest = page.replace(text, '')
    assert not re.search(r'https?:|//\w|@import|url\(|\bimport\(|fetch|XMLHttp|src=', rest)
    assert page.count('<script') == 2 == page.count('</script>')
    ids = set(re.findall(r'id="view-(\w+)"', page))
    assert set(re.findall(r"byId\('(\w+)'\)", SCRIPT)) <= ids and {'marks', 'cut', 'size'} <= ids
    assert 'Scenes to turn' not in render_report(RunReport('t'))


@pytest.mark.skipif(shutil.which('node') is None, reason='node is not installed')
def test_the_script_is_sound_and_decodes_as_written(tmp_path):
    """The script's own decoder, run outside a browser, gives the values that were packed."""
    path = tmp_path / 'view.js'
    path.write_text(SCRIPT)
    subprocess.run(['node', '--check', str(path)], check=True, timeout=60)
    view = a_view(20)
    parts = SCRIPT[
        SCRIPT.index('function bytes') : SCRIPT.index(
            '/* ---------------------------------------------------------------- colours'
        )
    ]
    told = f'const p = {json.dumps(pack_view(view))}; const s = open(p);' + (
        'console.log(JSON.stringify({xyz: [...s.xyz], classes: [...s.truth.values], '
        'regions: [...s.layers[1].values], prediction: s.prediction.name}));'
    )
    path.write_text(parts + told)
    out = json.loads(subprocess.run(['node', str(path)], check=True, timeout=60, capture_output=True).stdout)
    np.testing.assert_allclose(np.reshape(out['xyz'], (-1, 3)) + view.xyz.min(axis=0), view.xyz, atol=13 / 65535)
    np.testing.assert_array_equal(np.where(np.equal(out['classes'], 255), -1, out['classes']), view.layers[3].values)
    np.testing.assert_array_equal(np.where(np.equal(out['regions'], 65535), -1, out['regions']), view.layers[1].values)
    assert out['prediction'] == 'prediction'
