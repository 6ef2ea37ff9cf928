"""Answers of networks by round and method: what is trained, and the table by hand; nothing is trained."""

import json

from rm3d_plugin.engine.config import load_config
from rm3d_plugin.experiments.render import to_markdown
from rm3d_plugin.experiments.run_commands import config_path
from rm3d_plugin.experiments.runner import run_folder
from rm3d_plugin.experiments.spec import Request
from rm3d_plugin.experiments.tables import method_pseudo_labels as table


def test_all_are_observed_alike_and_learn_offsets():
    rows = {row.name: row for row in table.observed_rows()}
    assert list(rows) == ['OTOC', 'GPC', 'PSD', 'RM3D as in the paper', 'RM3D']
    for row in rows.values():
        config = load_config(config_path(row.config), 'run', True, dict(row.options))
        hooks = [hook for hook in config.custom_hooks if hook.type == 'PredictionQualityHook']
        assert [hook.threshold for hook in hooks] == [0.9]
        assert config.offset_weight == 1.0 and config.budget == '0p2pct'


def test_the_table_by_hand(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(table, 'run_rows', lambda rows, request, commands: asked.append((len(rows), request.seeds)))
    for place, row in enumerate(table.observed_rows()):
        folder = run_folder(tmp_path, row, 3)
        folder.mkdir(parents=True)
        told = {'0': {'coverage': 0.5, 'precision': 0.25 + place / 10, 'offset_error': None}}
        (folder / 'predicted_labels.json').write_text(json.dumps(told))
    filled = table.method_pseudo_label_table(Request(tmp_path, seed=3))
    assert asked == [(5, (3,))] and 'seed 3' in filled.title
    assert [section.title for section in filled.sections] == [row.name for row in table.observed_rows()]
    text = to_markdown(filled)
    assert '| 0 | 50.0 | 25.0 | - |' in text and '| 0 | 50.0 | 65.0 | - |' in text
