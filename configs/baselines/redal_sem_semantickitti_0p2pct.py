# ReDAL: classes of points of SemanticKITTI, from 0.2 % of the points; the network and schedule of rm3d_sem_semantickitti_0p2pct.
# Run: rm3d train redal_sem_semantickitti_0p2pct [--demo]
# Time: not measured.
# Score on SemanticKITTI: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = '../_base_/semantickitti.py'
budget = '0p2pct'
label_refreshes = None
propagate = False
label_maker = dict(source=dict(type='RegionRoundsSource', rounds='${label_refreshes}', geometry='${region_geometry}'))
