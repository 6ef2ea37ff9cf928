"""A few scans with boxes, one that nobody labelled: trained and predicted by the commands."""

from pathlib import Path

from reference.harbour import make_harbour

from rm3d_plugin.annotation import Session
from rm3d_plugin.annotation.box_exchange import export_boxes, import_boxes
from rm3d_plugin.datasets.box_formats import BOX_FORMATS

CONFIG = Path(__file__).resolve().parents[2] / 'configs' / 'rm3d_votenet_files_boxes.py'
TINY = (
    'widths=[8,16] hidden=16 model.vote_head.num_seeds=64 model.vote_head.num_proposals=16 sigma=1 rounds=2 '
    'warm_up_rounds=1 periods=[1,1] restart_weights=[1,1] val_rounds=2 batch_size=2 threads=1 descriptor_radius=1'
)


def through_a_session(world, root):
    """The same scans with their boxes as the labelling assistant writes them."""
    scans = sorted((world / 'points').iterdir())
    with Session(scans, root / 'clicks.jsonl') as session:
        for scan in scans:
            import_boxes(session.objects, scan.stem, [world / 'labels' / f'{scan.stem}.txt'])
        export_boxes(session, root)
    (root / 'val.txt').write_text((world / 'val.txt').read_text())
    return root


def test_from_boxes_of_a_labelling_tool_to_boxes_of_other_scans(call, tmp_path):
    world = through_a_session(make_harbour(tmp_path / 'harbour'), tmp_path / 'exported')
    (world / 'labels' / '001.txt').unlink()  # nobody labelled it
    options = ['--cfg-options', f'data_root={world}', f'cache_dir={tmp_path / "cache"}', *TINY.split()]
    code, output = call('train', CONFIG, '--work-dir', tmp_path / 'run', *options)
    assert code == 0, output
    for told in (
        'class boat: 3 annotated boxes, median 4 x 2 x 2 m',
        'voxel_size = 0.1',
        '6 of 6 boxes',
        'AP25',
        'recall50',
    ):
        assert told in output
    checkpoint = tmp_path / 'run' / 'epoch_2.pth'
    scans = world / 'points'
    code, output = call(
        'predict', checkpoint, scans, '--out', tmp_path / 'out', '--min-score', '0', '--format', 'sustech'
    )
    assert code == 0, output
    found = [BOX_FORMATS['sustech'].read(path, None) for path in sorted((tmp_path / 'out').iterdir())]
    assert len(found) == 4 and {name for boxes in found for name in boxes.names} <= {'boat', 'buoy'}
