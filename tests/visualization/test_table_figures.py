import pytest

from rm3d_plugin.visualization.tables import BarPanel, LinePanel, draw_bars, draw_lines

PNG = b'\x89PNG\r\n\x1a\n'


def test_pictures_are_png_and_alike():
    bars = [BarPanel('rooms', ['FPFH', 'SHOT'], {'before': [40.0, 30.0], 'after': [39.0, float('nan')]})] * 2
    assert draw_bars(bars, 'F1').startswith(PNG) and draw_bars(bars, 'F1') == draw_bars(bars, 'F1')
    assert draw_bars(bars, 'F1') != draw_bars(bars[:1], 'F1')
    names = [f'line {i}' for i in range(10)]
    lines = [
        [LinePanel('rooms', 'angle, degrees', ['0', '90'], {name: [1.0, 0.1 * i] for i, name in enumerate(names)})]
    ]
    assert draw_lines(lines * 2, 'cosine').startswith(PNG) and draw_lines(lines, 'c') == draw_lines(lines, 'c')


def test_what_cannot_be_drawn():
    with pytest.raises(ValueError, match="panel 'a': expected 2 values"):
        draw_bars([BarPanel('a', ['x', 'y'], {'before': [1.0]})], 'F1')
    with pytest.raises(ValueError, match="'a', 'x': expected 1 values"):
        draw_lines([[LinePanel('a', 'x', ['0'], {'x': [1.0, 2.0]})]], 'cosine')
    panel = LinePanel('a', 'x', ['0'], {})
    with pytest.raises(ValueError, match='differ in length'):
        draw_lines([[panel], [panel, panel]], 'cosine')
    for draw in (draw_bars, draw_lines):
        with pytest.raises(ValueError, match='at least one panel'):
            draw([], 'cosine')
