"""Labels that a person clicked and lists that others drew."""

import io
import json
import pickle

import numpy as np
import pytest
import torch

from rm3d_plugin.datasets import Truth
from rm3d_plugin.label_budgets import (
    BudgetError,
    PointAmount,
    budget_from_clicks,
    clicks_of,
    import_point_list,
    read_point_list,
    read_scene_list,
)
from rm3d_plugin.label_budgets.clicks import resolve_clicks
from rm3d_plugin.storage import Click
from rm3d_plugin.structures import Boxes3D, PointCloud

ORIGIN = (500000.0, 5600000.0, 100.0)
CLOUD = PointCloud(np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 0, 0], [5, 5, 5]], dtype=np.float32), origin=ORIGIN)


def write(path, text):
    path.write_text(text)
    return path


# ---------------------------------------------------------------------- clicks


def click(index=None, xyz=None, semantic=0, instance=-1, where='line 1'):
    world = None if xyz is None else tuple(float(a + b) for a, b in zip(xyz, ORIGIN, strict=True))
    return Click('s', semantic, instance, index, world, where)


def test_places_find_the_nearest_point_in_file_coordinates():
    found = resolve_clicks([click(xyz=(1.02, 0, 0.01), semantic=1), click(xyz=(2, 0, 0), instance=3), click(4)], CLOUD)
    assert found.points.tolist() == [1, 2, 4]  # of two points in one place the first
    assert found.semantic.tolist() == [1, 0, 0]
    assert found.instance.tolist() == [-1, 3, -1]
    assert resolve_clicks([click(4, instance=2)], CLOUD, instances=False).instance.tolist() == [-1]
    with pytest.raises(BudgetError, match=r'line 1: the nearest point of scene s is 0\.4 m .* more than 0\.05 m'):
        resolve_clicks([click(xyz=(1.4, 0, 0))], CLOUD)
    resolve_clicks([click(xyz=(1.4, 0, 0))], CLOUD, tolerance=0.41)
    with pytest.raises(BudgetError, match='point 0 of scene s is 1 m'):
        resolve_clicks([click(0, xyz=(1, 0, 0))], CLOUD)
    with pytest.raises(BudgetError, match=r'points 0\.\.4, got index 5'):
        resolve_clicks([click(5)], CLOUD)


def test_two_clicks_on_one_point_must_agree():
    assert resolve_clicks([click(1), click(xyz=(1, 0, 0))], CLOUD).points.tolist() == [1]
    with pytest.raises(BudgetError, match='line 9: point 1 of scene s has another label in line 1; keep one'):
        resolve_clicks([click(1), click(1, semantic=2, where='line 9')], CLOUD)


def test_clicks_count_the_points_of_the_file_where_the_scene_is_voxel_downsampled():
    rows = np.array([0, 0, 1, 2, 2, 3, 4, 4])  # eight points in the file, five kept
    found = resolve_clicks([click(4, semantic=1), click(1), click(5)], CLOUD, rows=rows)
    assert found.points.tolist() == [0, 2, 3] and found.semantic.tolist() == [0, 1, 0]
    back = clicks_of('s', found, CLOUD, rows)
    assert [c.index for c in back] == [0, 3, 5]
    again = resolve_clicks(back, CLOUD, rows=rows)
    assert again.points.tolist() == [0, 2, 3]
    with pytest.raises(BudgetError, match=r'points 0\.\.7, got index 8'):
        resolve_clicks([click(8)], CLOUD, rows=rows)


def test_budget_of_clicks():
    amount = PointAmount(clicks='my.csv')
    budget = budget_from_clicks(
        ['t', 's'], lambda scene: CLOUD, [click(1, semantic=1, instance=5), click(2)], amount, 0
    )
    assert budget.annotated_per_class == budget.total_per_class == {0: 1, 1: 1}
    assert budget.annotated['s'].points.tolist() == [1, 2] and len(budget.annotated['t'].points) == 0
    assert tuple(budget.sizes['s']) == (5, 2, 1) and not budget.complete
    with pytest.raises(BudgetError, match="line 1: there is no scene 's' among 1: t"):
        budget_from_clicks(['t'], lambda scene: CLOUD, [click(1)], amount, 0)


# ---------------------------------------------------------------------- lists

LISTED = {'scene0000_00': [3, 1], 'scene0001_00': [0]}


def truth_of(scene):
    return Truth(Boxes3D.empty(), np.array([0, 1, -1, 2]), np.array([-1, 5, -1, 6]))


def saved(tmp_path, kind):
    path = tmp_path / {'torch-arrays': 'points20', 'pickle': 'points50.pth', 'npz': 'p.npz', 'json': 'p.json'}.get(
        kind, 'p.pth'
    )
    arrays = {name: np.array(rows) for name, rows in LISTED.items()}
    if kind == 'npz':
        np.savez(path, **arrays)
    elif kind == 'json':
        path.write_text(json.dumps({f'scans/{name}_vh_clean_2.ply': rows for name, rows in LISTED.items()}))
    elif kind == 'pickle':
        torch.save(arrays, path, _use_new_zipfile_serialization=False)
    elif kind == 'torch-arrays':
        torch.save(arrays, path)
    elif kind == 'torch-tensors':
        torch.save({name: torch.tensor(rows) for name, rows in LISTED.items()}, path)
    else:
        torch.save({name: [np.int64(row) for row in rows] for name, rows in LISTED.items()}, path)
    return path


@pytest.mark.parametrize('kind', ['npz', 'json', 'pickle', 'torch-arrays', 'torch-tensors', 'torch-scalars'])
def test_point_lists_of_all_kinds(tmp_path, kind):
    path = saved(tmp_path, kind)
    assert {name: rows.tolist() for name, rows in read_point_list(path).items()} == LISTED
    scenes = ['scene0002_00', 'scene0000_00', 'scene0001_00']
    budget = import_point_list(scenes, truth_of, PointAmount(point_list=str(path)), 0)
    assert budget.annotated['scene0000_00'].points.tolist() == [1, 3]
    assert budget.annotated['scene0000_00'].semantic.tolist() == [1, 2]
    assert budget.annotated['scene0000_00'].instance.tolist() == [5, 6]
    assert budget.annotated['scene0002_00'].points.tolist() == []
    assert budget.annotated_count == 3


def test_arrays_written_by_an_old_numpy(tmp_path):
    stream = io.BytesIO()
    torch.save({'s': np.array([4, 2])}, stream, _use_new_zipfile_serialization=False)
    old = stream.getvalue().replace(b'numpy._core.multiarray', b'numpy.core.multiarray')
    assert old != stream.getvalue()
    (tmp_path / 'old.pth').write_bytes(old)
    assert read_point_list(tmp_path / 'old.pth')['s'].tolist() == [4, 2]


class Evil:
    def __reduce__(self):
        return (print, ('code of the file ran',))


def test_no_code_of_a_file_runs(tmp_path, capsys):
    torch.save({'s': Evil()}, tmp_path / 'evil.pth')
    (tmp_path / 'evil2.pth').write_bytes(pickle.dumps({'s': Evil()}))
    np.save(tmp_path / 'evil.npy', np.array({'s': Evil()}, dtype=object), allow_pickle=True)
    for name in ('evil.pth', 'evil2.pth', 'evil.npy'):
        with pytest.raises(BudgetError, match=rf'{name}: not readable as a list of points'):
            read_point_list(tmp_path / name)
    assert 'ran' not in capsys.readouterr().out


def test_lists_that_cannot_be_used(tmp_path):
    def refused(name, content, words):
        path = tmp_path / name
        path.write_text(content) if isinstance(content, str) else path.write_bytes(content)
        with pytest.raises(BudgetError, match=words):
            import_point_list(['scene0000_00'], truth_of, PointAmount(point_list=str(path)), 0)

    refused('a.json', '[1]', 'expected a mapping')
    refused('b.json', '{"scene0000_00": [0.5]}', 'scene scene0000_00: expected one row of whole numbers')
    refused('c.json', '{"scene0000_00": [4]}', r'has the points 0\.\.3, but the list names 4')
    refused('d.json', '{"scene0000_00": [-1]}', 'names -1')
    refused('e.json', '{"sceneX": [1], "sceneY": []}', 'names none of the 1 scenes; it names sceneX, sceneY')
    refused('f.json', '{"scene0000_00": [2]}', 'no point can be annotated')  # a point without a label
    refused('g.pth', b'junk', 'not readable')
    refused('h.json', '{', 'not readable')
    with pytest.raises(BudgetError, match='no such list'):
        read_point_list(tmp_path / 'none.pth')
    np.save(tmp_path / 'one.npy', np.arange(3))
    with pytest.raises(BudgetError, match='holds one array'):
        read_point_list(tmp_path / 'one.npy')


def test_lists_count_the_points_of_the_file_where_the_scene_is_voxel_downsampled(tmp_path):
    path = write(tmp_path / 'p.json', '{"s": [0, 5, 6]}')
    rows = np.array([0, 0, 1, 2, 2, 3, 3])
    budget = import_point_list(['s'], truth_of, PointAmount(point_list=str(path)), 0, lambda scene: rows)
    assert budget.annotated['s'].points.tolist() == [0, 3]


def test_scene_lists(tmp_path):
    path = write(tmp_path / 'scannetv2_train1.txt', 'scene0000_00\nscene0001_00_vh_clean_2.ply\n\nscene0999_00\n')
    assert read_scene_list(path) == ['scene0000_00', 'scene0001_00', 'scene0999_00']
    scenes = ['scene0000_00', 'scene0001_00', 'scene0002_00']
    budget = import_point_list(scenes, truth_of, PointAmount(scene_list=str(path)), 0)
    assert budget.complete == {'scene0000_00', 'scene0001_00'} and budget.annotated_count == 6
    with pytest.raises(BudgetError, match='names none of the 1 scenes'):
        import_point_list(['x'], truth_of, PointAmount(scene_list=str(path)), 0)
    with pytest.raises(BudgetError, match='names no scene'):
        read_scene_list(write(tmp_path / 'empty.txt', '\n'))
    with pytest.raises(BudgetError, match='no such list of scenes'):
        read_scene_list(tmp_path / 'none.txt')
    (tmp_path / 'own.txt').write_bytes('Büro 1.ply\r\nb\r\n'.encode('utf-16'))
    assert read_scene_list(tmp_path / 'own.txt') == ['Büro 1', 'b']


def test_two_lists_for_one_scene_are_told(tmp_path):
    path = write(tmp_path / 'p.json', '{"a.ply": [1], "scans/a.ply": [2]}')
    with pytest.raises(BudgetError, match=r"two lists for the scene a \(the second is 'scans/a.ply'\); join them"):
        read_point_list(path)


@pytest.mark.parametrize('index', [5, -1, 10**30])
def test_a_click_on_no_point(index):
    with pytest.raises(BudgetError, match=rf'line 1: scene s has the points 0\.\.4, got index {index}$'):
        resolve_clicks([click(0), click(index)], CLOUD)
