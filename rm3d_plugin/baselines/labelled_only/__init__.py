"""The network trained on the annotated points or boxes alone."""

from rm3d_plugin.baselines.base import Baseline

LABELLED_ONLY = Baseline(
    name='labelled_only',
    title='labelled {labels} alone',
    leaf='sup_{task}_{data}_{budget}',
    options={
        'sem': {'label_refreshes': 1, 'propagate': False},
        'ins': {
            'label_refreshes': 1,
            'propagate': False,
            'dice_loss': None,
            'offset_weight': 0.0,
            'point_group.proposals.coordinates': 'original',
        },
        'votenet': {'label_refreshes': 1},
    },
)
