# Weak baseline: the network and schedule of rm3d_sem_vkitti_1pct on the annotated points alone.
# Run: python tools/train.py configs/sup_sem_vkitti_1pct.py [--demo]
# Score on vKITTI 3D: not measured (the data set is not part of the repository). Demo scores: docs/RESULTS.md.
_base_ = ['./_base_/variants/sem_vkitti.py', './_base_/budgets/points_1pct.py']
label_refreshes = 1  # the first labels stay
propagate = False  # training sees the annotated points alone
