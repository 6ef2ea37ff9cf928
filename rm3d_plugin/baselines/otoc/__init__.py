"""One Thing One Click."""

from rm3d_plugin.baselines.base import Baseline
from rm3d_plugin.baselines.otoc.accept import PropagatedRegions
from rm3d_plugin.baselines.otoc.propagation import mean_field
from rm3d_plugin.baselines.otoc.relation import PrototypeRelation, prototype_contrast

OTOC = Baseline(
    name='otoc',
    title='OTOC',
    leaf='otoc_{task}_{data}_{budget}',
    options={
        'sem': {
            'label_maker.predicted': {'accept': {'type': 'PropagatedRegions'}, 'permanent': True, 'spread': True},
            'method_loss': {'type': 'PrototypeRelation', 'num_classes': '${num_classes}', 'channels': '${widths[0]}'},
        }
    },
)

__all__ = ['OTOC', 'PropagatedRegions', 'PrototypeRelation', 'mean_field', 'prototype_contrast']
