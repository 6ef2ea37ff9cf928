"""The network trained on all labels."""

from rm3d_plugin.baselines.base import Baseline

FULL_SUPERVISION = Baseline(
    name='full_supervision',
    title='all {labels}',
    leaf='sup_{task}_{data}_full',
    options={
        'sem': {'label_refreshes': 1, 'propagate': False, 'budget': 'full'},
        'ins': {'label_refreshes': 1, 'propagate': False, 'budget': 'full'},
        'votenet': {'label_refreshes': 1, 'budget': 'full'},
    },
)
