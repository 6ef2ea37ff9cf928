# Labels of points; a file of lengths (indoor.py, outdoor.py) goes with it.
_base_ = './hooks.py'
region_seeds = 'none'  # 'revealed': regions grow from the revealed points first; then each budget has its own
spread = True  # False: training sees the revealed points alone
labeler = dict(
    type='PointLabeler',
    source=dict(type='PointBudgetSource'),
    seeds='${region_seeds}',
    spread='${spread}',
    seed='${budget_seed}',
)
