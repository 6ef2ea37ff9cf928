"""The part of the report page about the pseudo labels of each round."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from rm3d_plugin.structures.label_estimate import estimate_text, has_estimate
from rm3d_plugin.visualization.report_sections import count, grouped_table, number, percent, section, table

_SEGMENTATION_WORDS = (
    '<p>Coverage is the share of the hidden points of a class that have a label; of all classes, the share of all '
    'points. Precision is the share of the pseudo labels given to a class that are correct. The offset error is the '
    'distance in metres between the centres of pseudo and true instance, mean over the hidden points that have both. '
    'Training never sees the truth that these are measured with.</p>'
)


def label_section(rounds: Sequence[Mapping[str, Any]]) -> str:
    """Pseudo labels of each round: points, then boxes."""
    if not rounds:
        return ''
    if not any(entry.get('boxes') for entry in rounds):
        return section('labels', 'Pseudo labels', _SEGMENTATION_WORDS + _estimate_table(rounds) + _class_table(rounds))
    parts = [_point_table(rounds), _box_table(rounds), _agreement_table(rounds), _warnings(rounds)]
    words = (
        '<p>Coverage is the share of all points with a label. Precision is the share of correct pseudo labels; recall '
        'of boxes is over the true boxes that the budget hides. Training never sees the truth that these are '
        'measured with.</p>'
    )
    return section('labels', 'Pseudo labels', words + ''.join(parts))


def _estimate_table(rounds: Sequence[Mapping[str, Any]]) -> str:
    """What left-out clicks say of the rounds that were checked by them."""
    checked = [(place, entry) for place, entry in enumerate(rounds) if has_estimate(entry)]
    if not checked:
        return ''
    body = [[str(entry.get('round', place)), escape(estimate_text(entry))] for place, entry in checked]
    return table(['Round', 'Labels of all points'], body, 'Estimated from clicks that were left out', 2)


def _class_table(rounds: Sequence[Mapping[str, Any]]) -> str:
    """A row for each class, a group of columns for each round."""
    offsets = any(entry.get('offset_error') is not None for entry in rounds)
    columns = ('labels', 'coverage', 'precision', *(['offset (m)'] if offsets else []))
    body = [['all', *(cell for entry in rounds for cell in _whole_cells(entry, offsets))]]
    for name in _names(rounds, 'points'):
        found = [entry.get('points', {}).get(name, {}) for entry in rounds]
        body.append([escape(name), *(cell for row in found for cell in _class_cells(row, offsets))])
    head = [('Class', ()), *((f'Round {entry.get("round", i)}', columns) for i, entry in enumerate(rounds))]
    return grouped_table(head, body, 'Points, by class and round', [0])


def _whole_cells(entry: Mapping[str, Any], offsets: bool) -> list[str]:
    total = sum(row.get('pseudo') or 0 for row in entry.get('points', {}).values())
    return _class_cells({**entry, 'pseudo': total}, offsets)


def _class_cells(row: Mapping[str, Any], offsets: bool) -> list[str]:
    cells = [count(row.get('pseudo')), percent(row.get('coverage')), percent(row.get('precision'))]
    return [*cells, number(row.get('offset_error'))] if offsets else cells


def _point_table(rounds: Sequence[Mapping[str, Any]]) -> str:
    names = _names(rounds, 'points')
    body = []
    for place, entry in enumerate(rounds):
        row = [str(entry.get('round', place)), percent(entry.get('coverage'))]
        for name in names:
            found = entry.get('points', {}).get(name, {})
            row += [count(found.get('pseudo')), percent(found.get('precision'))]
        body.append(row)
    head = [('Round', ()), ('Coverage', ()), *((name, ('labels', 'precision')) for name in names)]
    return grouped_table(head, body, 'Points')


def _box_table(rounds: Sequence[Mapping[str, Any]]) -> str:
    names = _names(rounds, 'boxes')
    body = []
    for place, entry in enumerate(rounds):
        row = [str(entry.get('round', place))]
        known = entry.get('truth_known', True)
        for name in names:
            found = entry.get('boxes', {}).get(name, {})
            pseudo, correct = found.get('pseudo', 0), found.get('correct', 0)
            hidden = found.get('true', 0) - found.get('annotated', 0)
            row += [count(found.get('annotated')), count(found.get('pseudo'))]
            row.append(percent(correct / pseudo if known and pseudo else None))
            row.append(percent(correct / hidden if known and hidden > 0 else None))
        body.append(row)
    head = [('Round', ()), *((name, ('annotated', 'pseudo', 'precision', 'recall')) for name in names)]
    return grouped_table(head, body, 'Boxes')


def _agreement_table(rounds: Sequence[Mapping[str, Any]]) -> str:
    """How far classes, instances and boxes of the scenes say the same, from the first round with a network on."""
    names, body = _names(rounds, 'boxes'), []
    for place, entry in enumerate(rounds):
        told = [entry.get('boxes', {}).get(name, {}).get('agreement') for name in names]
        if not any(told):
            continue
        row = [str(entry.get('round', place))]
        for found in told:
            counts = found or {}
            for part, whole in (
                ('boxes_with_instance', 'boxes'),
                ('instances_with_box', 'instances'),
                ('points_of_class', 'points_in_boxes'),
            ):
                row.append(percent(counts[part] / counts[whole] if counts.get(whole) else None))
        body.append(row)
    if not body:
        return ''
    columns = ('boxes that are an instance', 'instances that are a box', 'points in boxes with their class')
    head = [('Round', ()), *((name, columns) for name in names)]
    return grouped_table(head, body, 'Classes, instances and boxes: how far they agree')


def _warnings(rounds: Sequence[Mapping[str, Any]]) -> str:
    """Classes without a pseudo box, or with far more than there seem to be, and the step that lost or made them."""
    told = [
        f'<li>Round {entry.get("round", place)}: {escape(text)}</li>'
        for place, entry in enumerate(rounds)
        for text in entry.get('warnings', ())
    ]
    return f'<p>Warnings:</p><ul class="warnings">{"".join(told)}</ul>' if told else ''


def _names(rounds: Sequence[Mapping[str, Any]], key: str) -> list[str]:
    return list(dict.fromkeys(name for entry in rounds for name in entry.get(key, {})))
