# Labels of points; a file of lengths (indoor.py, outdoor.py) goes with it.
_base_ = './hooks.py'
region_seeds = 'none'  # 'annotated': regions grow from the annotated points first; then each budget has its own
spread = True  # False: training sees the annotated points alone
label_maker = dict(
    type='SegmentationLabelMaker',
    source=dict(type='PointBudgetSource'),
    seeds='${region_seeds}',
    spread='${spread}',
    seed='${budget_seed}',
)
