"""docs/parts.md lists every part that a project of mmengine can name."""

import pytest
from runs.tiny_runs import ROOT

from rm3d_plugin import registry

TEXT = (ROOT / 'docs' / 'parts.md').read_text(encoding='utf-8')


@pytest.mark.parametrize('name', ['MODELS', 'METRICS', 'HOOKS', 'LOOPS'])
def test_every_part_is_listed(name):
    parts = getattr(registry, name)
    parts.import_from_location()
    places = {kind: part.__module__ for kind, part in parts.module_dict.items()}
    own = [kind for kind, place in places.items() if place.startswith('rm3d_plugin.') and '.benchmarks.' not in place]
    assert own and [kind for kind in own if f'`{kind}`' not in TEXT and f'`rm3d_plugin.{kind}`' not in TEXT] == []
