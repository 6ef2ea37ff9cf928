# Labels of points; a file of lengths (indoor.py, outdoor.py) goes with it.
_base_ = './hooks.py'
region_seeds = 'none'  # 'annotated': regions grow from the annotated points first; then each budget has its own
propagate = True  # False: training sees the annotated points alone
propagation = None  # how far annotated points speak for their regions
region_prior = None  # what regions may be before the network is asked
ground = None  # when points of the ground are named one by one
label_maker = dict(
    type='point_label_maker',
    source=dict(type='PointBudgetSource'),
    seeds='${region_seeds}',
    propagate='${propagate}',
    propagation='${propagation}',
    region_prior='${region_prior}',
    ground='${ground}',
    seed='${budget_seed}',
)
