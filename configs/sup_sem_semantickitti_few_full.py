# Full supervision: the network and schedule of rm3d_sem_semantickitti_few_1pct on all labels.
# Run: python tools/train.py configs/sup_sem_semantickitti_few_full.py --cfg-options data_root=FOLDER [--demo]
# Score on SemanticKITTI: docs/RESULTS.md.
_base_ = ['./_base_/variants/sem_semantickitti_few.py', './_base_/budgets/points_full.py']
label_refreshes = 1  # the labels stay
propagate = False  # nothing is left to propagate to
