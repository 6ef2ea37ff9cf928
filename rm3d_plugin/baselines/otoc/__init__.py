"""One Thing One Click."""

from rm3d_plugin.baselines.method import method
from rm3d_plugin.baselines.otoc.accept import PropagatedRegions
from rm3d_plugin.baselines.otoc.propagation import mean_field
from rm3d_plugin.baselines.otoc.relation import PrototypeRelation, prototype_contrast

PARTS = {
    'label_refreshes': None,
    'label_maker.predicted': {'accept': {'type': 'PropagatedRegions'}, 'permanent': True, 'spread': True},
    'method_loss': {'type': 'PrototypeRelation', 'num_classes': '${num_classes}', 'channels': '${widths[0]}'},
}
OTOC = method('otoc', 'OTOC', {'sem': PARTS, 'ins': PARTS}, declares=('regions',))

__all__ = ['OTOC', 'PropagatedRegions', 'PrototypeRelation', 'mean_field', 'prototype_contrast']
