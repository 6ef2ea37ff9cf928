# OTOC: classes of points of Oakland, from 1 % of the points; the network and schedule of rm3d_sem_oakland_1pct.
# Run: rm3d train otoc_sem_oakland_1pct
# Time: not measured.
# Score on Oakland: docs/RESULTS.md.
_base_ = '../_base_/oakland.py'
budget = '1pct'
label_refreshes = None
propagate = False
label_maker = dict(predicted=dict(accept=dict(type='PropagatedRegions'), permanent=True, spread=True))
method_loss = dict(type='PrototypeRelation', num_classes='${num_classes}', channels='${widths[0]}')
