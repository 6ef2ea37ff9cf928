# ReDAL: classes of points of Oakland, from 1 % of the points; the network and schedule of rm3d_sem_oakland_1pct.
# Run: rm3d train redal_sem_oakland_1pct
# Time: not measured.
# Score on Oakland: not measured.
_base_ = '../_base_/oakland.py'
budget = '1pct'
label_refreshes = None
propagate = False
label_maker = dict(source=dict(type='RegionRoundsSource', rounds='${label_refreshes}', geometry='${region_geometry}'))
