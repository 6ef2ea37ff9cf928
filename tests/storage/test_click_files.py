"""Click files: CSV, JSON and logs are read alike, and what cannot be used is named by file, line and field."""

import json

import pytest

from rm3d_plugin.storage import Click, ClickFileError, DamagedFileError, click_classes, read_clicks, write_clicks
from rm3d_plugin.storage.click_log_lines import read_click_log
from rm3d_plugin.structures import SceneError

CLASSES = ('floor', 'wall', '7', 'chair, red')
HEAD = '{"kind": "clicks", "format": 1}\n'


def write(path, text):
    path.write_text(text)
    return path


def test_both_kinds_of_csv(tmp_path):
    by_index = read_clicks(write(tmp_path / 'a.csv', 'scene,index,class\nx,3,wall\n y , 0 , 0\n'), CLASSES)
    assert [(c.scene, c.index, c.semantic, c.instance, c.xyz) for c in by_index] == [
        ('x', 3, 1, -1, None),
        ('y', 0, 0, -1, None),
    ]
    text = '\ufeffClass, x,y,z,scene,instance,who\n"chair, red",1.5,2,-3e1,s,4,me\nfloor,0,0,0,s,,me\n'
    by_place = read_clicks(write(tmp_path / 'b.csv', text), CLASSES)
    assert [(c.scene, c.index, c.semantic, c.instance, c.xyz) for c in by_place] == [
        ('s', None, 3, 4, (1.5, 2.0, -30.0)),
        ('s', None, 0, -1, (0.0, 0.0, 0.0)),
    ]


def test_json_and_numbers_for_classes(tmp_path):
    rows = [
        {'scene': 's', 'index': 2, 'class': 3},
        {'scene': 's', 'x': 1, 'y': 2.5, 'z': 0, 'class': 'wall', 'instance': 0},
    ]
    clicks = read_clicks(write(tmp_path / 'c.json', json.dumps(rows)), CLASSES)
    assert [(c.index, c.semantic, c.instance, c.xyz) for c in clicks] == [
        (2, 3, -1, None),
        (None, 1, 0, (1.0, 2.5, 0.0)),
    ]
    named_seven = read_clicks(write(tmp_path / 'd.csv', 'scene,index,class\ns,0,7\n'), CLASSES)
    assert named_seven[0].semantic == 2  # a name comes before a number


@pytest.mark.parametrize('name', ['c.csv', 'c.json', 'c.jsonl'])
def test_written_clicks_come_back(tmp_path, name):
    clicks = [
        Click('s', 3, 4, 17, (500001.125, 5600000.25, 3.0), 'click'),
        Click('t', 0, -1, 0, None, 'click'),
        Click('t', 1, -1, None, (0.5, 0.0, 0.0), 'click'),
    ]
    write_clicks(tmp_path / name, clicks, CLASSES)
    again = read_clicks(tmp_path / name, CLASSES)
    assert again == clicks
    assert click_classes(tmp_path / name) == ['chair, red', 'floor', 'wall']
    assert again[0].where.startswith(str(tmp_path / name))


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('', 'first line must name the columns'),
        ('scene,class\ns,wall\n', 'first line must name the columns.*got .scene,class.'),
        ('scene,index,class\n', 'holds no click'),
        (
            'scene,index,class\ns,1,door\n',
            'line 2: class: expected one of floor, wall, 7, chair, red or 0..3, got .door.',
        ),
        ('scene,index,class\ns,1,9\n', 'line 2: class'),
        ('scene,index,class\ns,1.5,wall\n', 'line 2: index: expected a whole number'),
        ('scene,x,y,z,class\ns,1,nan,0,wall\n', 'line 2: y: expected a number'),
        ('scene,x,y,z,class\ns,1,,0,wall\n', 'line 2: expected an index or x, y and z'),
        ('scene,index,class\n,1,wall\n', 'line 2: no scene'),
        ('scene,index,class\ns,,wall\n', 'line 2: expected an index'),
        ('scene,index,class\ns\n', 'line 2: class: is empty; name one'),
        ('scene,index,class,instance\ns,1,wall,two\n', 'line 2: instance'),
        (f'scene,index,class\ns,{10**30},wall\n', 'line 2: index: expected a whole number'),
        (f'scene,index,class,instance\ns,1,wall,{10**400}\n', 'line 2: instance: expected a whole number'),
        ('scene,index,class\ns,1,\u00b2\n', 'line 2: class: expected one of'),
        ('scene,index,class\ns,1,wall,2\n', "line 2: more cells than the first line has names: '2'"),
        ('scene;index;class\ns;1;wall;2;3\n', "line 2: more cells than the first line has names: '2;3'"),
    ],
)
def test_lines_that_cannot_be_used(tmp_path, text, words):
    path = write(tmp_path / 'bad.csv', text)
    with pytest.raises(ClickFileError, match=words) as error:
        read_clicks(path, CLASSES)
    assert 'bad.csv' in str(error.value)


def test_files_that_cannot_be_used(tmp_path):
    with pytest.raises(ClickFileError, match='no such file of clicks'):
        read_clicks(tmp_path / 'none.csv', CLASSES)
    with pytest.raises(ClickFileError, match='expected a list of objects'):
        read_clicks(write(tmp_path / 'a.json', '{"scene": 1}'), CLASSES)
    (tmp_path / 'b.csv').write_bytes(b'scene,index,class\nb\xfcro,1,wall\n')
    with pytest.raises(SceneError, match=r'b\.csv, line 2: byte 0xfc is no UTF-8; save the file as UTF-8 text'):
        read_clicks(tmp_path / 'b.csv', CLASSES)


@pytest.mark.parametrize('separator', [';', '\t'])
def test_clicks_of_a_spreadsheet(tmp_path, separator):
    text = '\ufeffscene;x;y;z;class\r\ns;1,5;-2,25;0;wall\r\n'.replace(';', separator)
    (click,) = read_clicks(write(tmp_path / 'a.csv', text), CLASSES)
    assert (click.scene, click.xyz, click.semantic) == ('s', (1.5, -2.25, 0.0), 1)


@pytest.mark.parametrize('name', ['a.json', 'a.jsonl'])
def test_json_nested_too_deeply_is_damaged(tmp_path, name):
    with pytest.raises((ClickFileError, DamagedFileError), match='nested too deeply'):
        read_clicks(write(tmp_path / name, '[' * 100_000 + '\n'), CLASSES)


def test_a_click_says_where_it_is():
    with pytest.raises(ClickFileError, match='click: no scene given'):
        Click('', 0, index=1)
    with pytest.raises(ClickFileError, match='here: expected an index or x, y and z'):
        Click('s', 0, where='here')


@pytest.mark.parametrize('semantic', [-1, 4])
def test_a_class_that_is_not_there_is_not_written(tmp_path, semantic):
    with pytest.raises(ClickFileError, match=rf'class: expected a number 0\.\.3, got {semantic}'):
        write_clicks(tmp_path / 'c.csv', [Click('s', semantic, index=1)], CLASSES)
    assert not (tmp_path / 'c.csv').exists()


LINES = [
    '{"click": 1, "scene": "s", "index": 5, "class": "wall"}\n',
    '{"click": 2, "scene": "s", "x": 1, "y": 2, "z": 3.5, "class": "chair, red", "instance": 2}\n',
    '{"undo": 1}\n',
    '{"click": 3, "scene": "t", "index": 0, "class": "floor"}\n',
]


def test_a_log_without_what_was_taken_back(tmp_path):
    path = write(tmp_path / 'c.jsonl', HEAD + ''.join(LINES))
    kept = [Click('s', 3, 2, xyz=(1.0, 2.0, 3.5)), Click('t', 0, index=0)]
    assert read_clicks(path, CLASSES) == kept
    log = read_click_log(path, CLASSES)
    assert log.standing == {2: kept[:1], 3: kept[1:]} and log.last == 3
    assert log.size == path.stat().st_size
    assert click_classes(path) == ['chair, red', 'floor']


@pytest.mark.parametrize('cut', [1, 20, 54])
def test_a_line_that_was_cut_off_does_not_count(tmp_path, cut):
    whole = HEAD + LINES[0]
    path = write(tmp_path / 'c.jsonl', whole + LINES[3][:cut])
    log = read_click_log(path, CLASSES)
    assert list(log.standing) == [1] and log.size == len(whole)
    path.write_text(whole + LINES[1].rstrip())  # whole, but for the newline
    assert list(read_click_log(path, CLASSES).standing) == [1, 2]


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('', 'line 1: expected .*; this is no log of clicks'),
        (LINES[0], 'line 1: expected'),
        ('{"kind": "clicks", "format": 2}\n', 'line 1: expected .*"format": 1'),
        (HEAD, 'holds no click'),
        (HEAD + LINES[0] + '{"click": 2, \n' + LINES[2], 'line 3: not readable as JSON .*mend or delete this line'),
        (HEAD + '[1]\n', 'line 2: expected an object'),
        (HEAD + LINES[1], 'line 2: click: expected number 1, got 2'),
        (HEAD + LINES[2], 'line 2: undo: no click 1 stands before this line'),
        (HEAD + '{"undo": [1]}\n', r'line 2: undo: no click \[1\] stands'),
        (HEAD + LINES[0] + LINES[2] + LINES[2], 'line 4: undo: no click 1'),
        (HEAD + LINES[0].replace('wall', 'door'), "line 2: class: expected one of .* got 'door'"),
        (HEAD + LINES[0].replace('5', '1.5'), "line 2: index: expected a whole number, got '1.5'"),
    ],
)
def test_logs_that_cannot_be_used(tmp_path, text, words):
    with pytest.raises(ClickFileError, match=rf'bad\.jsonl.*{words}'):
        read_clicks(write(tmp_path / 'bad.jsonl', text), CLASSES)


@pytest.mark.parametrize(
    ('text', 'told'),
    [
        ('scene,index,class,class\na,1,wall,floor\n', "names two columns 'class'; leave one of them"),
        ('scene,index,Index,class\na,1,2,wall\n', "names two columns 'index'"),
        ('scene,index,class\na,1_0,wall\n', "line 2: index: expected a whole number, got '1_0'"),
        ('scene,x,y,z,class\na,1_0,0,0,wall\n', "line 2: x: expected a number, got '1_0'"),
    ],
)
def test_cells_that_could_mean_two_things_are_told(tmp_path, text, told):
    with pytest.raises(ClickFileError, match=told):
        read_clicks(write(tmp_path / 'a.csv', text), CLASSES)


def test_clicks_saved_as_unicode_text(tmp_path):
    """Excel's 'Unicode text': UTF-16 with tabs."""
    (tmp_path / 'a.csv').write_bytes('scene\tx\ty\tz\tclass\r\nBüro 1\t1,5\t2\t3\t0\r\n'.encode('utf-16'))
    click = read_clicks(tmp_path / 'a.csv', CLASSES)[0]
    assert (click.scene, click.xyz, click.semantic) == ('Büro 1', (1.5, 2.0, 3.0), 0)
