"""Which scans label propagation takes, and how regions alone are scored."""

import pytest

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.engine.reproduce_points import oakland_scans, propagation_table, semantickitti_scans


def test_every_tile_and_every_scan_is_taken_by_itself(tmp_path):
    for name in ('oakland_part2_ac', 'oakland_part3_ao'):
        (tmp_path / f'{name}.xyz_label_conf').touch()
    assert [scan.options['train_tiles'] for scan in oakland_scans(tmp_path)] == [['part2_ac'], ['part3_ao']]
    for sequence, number in (('01', '000001'), ('01', '000000'), ('99', '000700')):
        for part, ending in (('velodyne', '.bin'), ('labels', '.label')):
            folder = tmp_path / 'kitti' / 'sequences' / sequence / part
            folder.mkdir(parents=True, exist_ok=True)
            (folder / f'{number}{ending}').write_text(f'{sequence} {number} {part}')
    scans = semantickitti_scans(tmp_path / 'kitti', tmp_path / 'out')
    assert [scan.name for scan in scans] == [
        f'SemanticKITTI {name}' for name in ('01/000000', '01/000001', '99/000700')
    ]
    alone = tmp_path / 'out' / '01_000001' / 'sequences' / '00'
    assert (alone / 'velodyne' / '000001.bin').read_text() == '01 000001 velodyne'
    assert len(list(alone.glob('*/*'))) == 2 and scans[1].options['val_sequences'] == [0]


def test_without_real_scans_it_says_where_it_looked(tmp_path):
    with pytest.raises(ConfigError, match=r'no oakland/\*\.xyz_label_conf'):
        propagation_table(tmp_path / 'out', data_root=tmp_path)
