"""Files of boxes: what labelling tools write is read, what is written reads back, what is wrong is told."""

import json

import numpy as np
import pytest
from kitti_world import CALIB

from rm3d_plugin.datasets.box_formats import BOX_FORMATS, find_format, labelcloud_format
from rm3d_plugin.datasets.named_boxes import BoxFileError, NamedBoxes
from rm3d_plugin.structures import SceneError

ROWS = np.array([[12.0, 3, 0.5, 4, 2, 1.5, 2.5], [20, -4, 0.2, 0.8, 0.6, 1.7, -1.0], [9, 1, 0, 2, 2, 2, 0]])
BOXES = NamedBoxes(['car', 'person', 'car'], ROWS, np.array([0.9, 0.5, 0.25]))
# decimals that a format keeps: KITTI's lines have two, of the bottom's place and of the size
EXACT = {'kitti': 0.011, 'json': 6e-4}


@pytest.mark.parametrize('name', BOX_FORMATS)
def test_what_is_written_reads_back_and_is_told_apart(name, tmp_path):
    kind = BOX_FORMATS[name]
    path = kind.write(tmp_path / f'scan{kind.ending}', BOXES, 'scan.ply', CALIB)
    assert find_format([path]) == name
    back = kind.read(path, CALIB)
    assert [word.lower() for word in back.names] == BOXES.names  # KITTI's classes are spelt as KITTI does
    np.testing.assert_allclose(back.tensor, ROWS, atol=EXACT.get(name, 1e-5))
    if back.scores is not None:
        np.testing.assert_allclose(back.scores, BOXES.scores, atol=1e-4)


@pytest.mark.parametrize('name', BOX_FORMATS)
def test_no_box_is_a_file_too(name, tmp_path):
    kind = BOX_FORMATS[name]
    path = kind.write(tmp_path / f'scan{kind.ending}', NamedBoxes([], np.zeros((0, 7))), 'scan.ply', CALIB)
    assert len(kind.read(path, CALIB).tensor) == 0


def labelcloud(path, **item):
    path.write_text(json.dumps({'folder': 'scans', 'filename': 'a.ply', 'objects': [{'name': 'cart', **item}]}))
    return path


def centroid(path, angle, size=(4, 2, 1), tilt=0.0):
    return labelcloud(
        path,
        centroid=dict(x=1, y=2, z=3),
        dimensions=dict(length=size[0], width=size[1], height=size[2]),
        rotations=dict(x=tilt, y=0, z=angle),
    )


def test_labelclouds_own_example_of_each_form(tmp_path):
    expected = [[1, 2, 3, 4, 2, 1, np.pi / 2]]
    rel, absolute = centroid(tmp_path / 'rel.json', np.pi / 2), centroid(tmp_path / 'abs.json', 90)
    np.testing.assert_allclose(BOX_FORMATS['labelcloud_rel'].read(rel, None).tensor, expected)
    np.testing.assert_allclose(BOX_FORMATS['labelcloud_abs'].read(absolute, None).tensor, expected)
    # its corners begin behind on the right and go clockwise, the bottom first; turned by 90 degrees x becomes y
    corners = [[2, 0], [0, 0], [0, 4], [2, 4]]
    eight = [[x, y, z] for z in (2.5, 3.5) for x, y in corners]
    path = labelcloud(tmp_path / 'corners.json', vertices=eight)
    np.testing.assert_allclose(BOX_FORMATS['labelcloud_vertices'].read(path, None).tensor, expected)


def test_degrees_and_radians_are_told_from_all_files(tmp_path):
    small, negative, large = (centroid(tmp_path / f'{i}.json', angle) for i, angle in enumerate((1.0, -1.0, 200.0)))
    assert find_format([small, negative]) == 'labelcloud_rel'
    assert find_format([small, large]) == 'labelcloud_abs'
    assert find_format([centroid(tmp_path / 'zero.json', 0)]) == 'labelcloud_rel'  # the same either way
    with pytest.raises(BoxFileError, match=r'between 0 and 1, which may be radians or degrees; pass box_format='):
        find_format([small])


def test_sustechs_own_example(tmp_path):
    part = {
        name: dict(zip('xyz', values, strict=True)) for name, values in (('position', (1, 2, 3)), ('scale', (4, 2, 1)))
    }
    item = {'obj_id': '1', 'obj_type': 'Car', 'psr': part | {'rotation': dict(x=0, y=0, z=-0.5)}}
    path = tmp_path / '000.json'
    path.write_text(json.dumps([item]))
    found = BOX_FORMATS['sustech'].read(path, None)
    assert found.names == ['Car'] and found.tensor.tolist() == [[1, 2, 3, 4, 2, 1, -0.5]]


@pytest.mark.parametrize(
    ('line', 'told'),
    [
        ('1 2 3 4 5 6 car', r'a.txt, line 1: expected x y z dx dy dz yaw class \[score\], got 7 words'),
        ('1 2 3 4 nan 6 0 car', "line 1: dy is 'nan', expected a finite number; correct or remove the box"),
        ('1 2 3 4 5 wide 0 car', "line 1: dz is 'wide', expected a number"),
        ('1 2 3 4 0 6 0 car', 'line 1: width is 0 m, expected a length above 0; correct or remove the box'),
    ],
)
def test_a_bad_line_is_told_with_file_line_and_field(line, told, tmp_path):
    path = tmp_path / 'a.txt'
    path.write_text(line + '\n')
    with pytest.raises(BoxFileError, match=told):
        BOX_FORMATS['openpcdet'].read(path, None)


def test_a_bad_object_is_told_with_file_object_and_field(tmp_path):
    read = BOX_FORMATS['labelcloud_rel'].read
    with pytest.raises(BoxFileError, match='object 1: height is -1 m'):
        read(centroid(tmp_path / 'a.json', 0, size=(4, 2, -1)), None)
    with pytest.raises(BoxFileError, match='object 1: .* is 1000000000.*, expected a number'):
        read(centroid(tmp_path / 'a.json', 0, size=(10**400, 2, 1)), None)
    with pytest.raises(BoxFileError, match='rotation about x is 17.2 degrees; boxes stand upright'):
        read(centroid(tmp_path / 'b.json', 0, tilt=0.3), None)
    with pytest.raises(BoxFileError, match="object 1: expected a field 'centroid', got name"):
        read(labelcloud(tmp_path / 'c.json'), None)
    (tmp_path / 'd.json').write_text('{"objects": [')
    with pytest.raises(BoxFileError, match='d.json: not JSON'):
        read(tmp_path / 'd.json', None)
    with pytest.raises(BoxFileError, match='8 corners'):
        BOX_FORMATS['labelcloud_vertices'].read(labelcloud(tmp_path / 'e.json', vertices=[[0, 0, 0]]), None)


def test_kitti_needs_a_calibration_to_read_and_to_write(tmp_path):
    kind = BOX_FORMATS['kitti']
    path = kind.write(tmp_path / 'label_2' / '0.txt', BOXES, '0.bin', CALIB)
    with pytest.raises(BoxFileError, match=f'a calibration is needed; expected {tmp_path}/calib/0.txt'):
        kind.read(path, None)
    with pytest.raises(BoxFileError, match='the scan 0.bin has no calibration'):
        kind.write(path, BOXES, '0.bin', None)


def test_files_of_no_or_of_several_formats(tmp_path):
    (tmp_path / 'a.txt').write_text('1 2 3\n')
    with pytest.raises(BoxFileError, match='a.txt: a line of 3 words; expected 15 or 16 .* or 8 or 9'):
        find_format([tmp_path / 'a.txt'])
    (tmp_path / 'b.json').write_text('{"things": 1}')
    with pytest.raises(BoxFileError, match='b.json: expected labelCloud'):
        find_format([tmp_path / 'b.json'])
    (tmp_path / 'c.json').write_text('[{"psr": 0}]')
    with pytest.raises(BoxFileError, match='several formats .*keep one, or name it: box_format='):
        find_format([tmp_path / 'c.json', centroid(tmp_path / 'd.json', 1)])


def test_boxes_of_classes_are_numbered_and_others_left_out():
    boxes = BOXES.of_classes(['person', 'car'])
    assert boxes.labels.tolist() == [1, 0, 1] and boxes.scores.tolist() == [0.9, 0.5, 0.25]
    assert BOXES.of_classes(['Person']).tensor.tolist() == [ROWS[1].tolist()]
    assert NamedBoxes.from_boxes(boxes, ['person', 'car']).names == BOXES.names


def test_what_labelcloud_says_of_its_files(tmp_path):
    """``_classes.json`` tells degrees from radians where the numbers do not."""
    path = centroid(tmp_path / 'a.json', 1.5)
    assert labelcloud_format(tmp_path) is None
    for told, kind in (('centroid_abs', 'labelcloud_abs'), ('centroid_rel', 'labelcloud_rel')):
        (tmp_path / '_classes.json').write_text(json.dumps({'classes': [{'name': 'cart', 'id': 0}], 'format': told}))
        assert find_format([path], labelcloud_format(tmp_path)) == kind
    with pytest.raises(BoxFileError, match='may be radians or degrees'):
        find_format([path])
    for turn, says, looks in ((90, 'centroid_rel', 'degrees'), (-3, 'centroid_abs', 'radians')):
        with pytest.raises(BoxFileError, match=f'_classes.json: format {says}, but the rotations look like {looks}'):
            find_format([centroid(path, turn)], says)
    assert find_format([centroid(path, 90)]) == 'labelcloud_abs'
    kitti = BOX_FORMATS['kitti'].write(tmp_path / 'a.txt', BOXES, 'a.ply', CALIB)
    with pytest.raises(BoxFileError, match='labelCloud saved these boxes as kitti_untransformed'):
        find_format([kitti], 'kitti_untransformed')


@pytest.mark.parametrize(
    ('name', 'text', 'told'),
    [
        ('labelcloud_rel', '{"objects": null}', 'objects: expected a list, got None'),
        (
            'labelcloud_vertices',
            '{"objects": [{"name": "a", "vertices": [1, 2, 3, 4, 5, 6, 7, 8]}]}',
            'expected 8 corners',
        ),
        ('json', '{"boxes": 5}', 'boxes: expected a list, got 5'),
        ('json', '{"boxes": [{"center": 5, "size": [1, 1, 1], "yaw": 0, "class": "a"}]}', 'center: expected a list'),
        ('json', '{"boxes": [{"center": [true, 0, 0], "size": [1, 1, 1], "yaw": 0, "class": "a"}]}', 'center is True'),
        ('json', '{"boxes": [{"center": ["1_0", 0, 0], "size": [1, 1, 1], "yaw": 0, "class": "a"}]}', "is '1_0'"),
        ('json', '{"boxes": [{"center": [0, 0, 0], "size": [1, 1, 1], "yaw": 0, "class": null}]}', 'class is None'),
        (
            'json',
            '{"boxes": [{"center": [0, 0, 0], "size": [1, 1, 1], "yaw": 90, "class": "a"}]}',
            'is 90, expected radians',
        ),
        ('openpcdet', '1 2 3 4 5 6 90 car', 'line 1: the turn about z is 90, expected radians; degrees'),
        ('openpcdet', '1 2 3 4 5 6 0 Fu\xdf', 'line 1: byte 0xdf is no UTF-8; save the file as UTF-8 text'),
    ],
)
def test_fields_of_another_kind_are_told(name, text, told, tmp_path):
    path = tmp_path / f'a{BOX_FORMATS[name].ending}'
    path.write_bytes(text.encode('latin-1'))
    with pytest.raises(SceneError, match=told):
        BOX_FORMATS[name].read(path, None)
