# Full supervision: the network and schedule of rm3d_sem_semantic3d_* on all labels.
# Run: python tools/train.py configs/sup_sem_semantic3d_full.py [--demo]
# Score on Semantic3D: not measured (the data set is not part of the repository). Demo scores: docs/RESULTS.md.
_base_ = ['./_base_/variants/sem_semantic3d.py', './_base_/budgets/points_full.py']
label_refreshes = 1  # the labels stay
propagate = False  # nothing is left to propagate to
