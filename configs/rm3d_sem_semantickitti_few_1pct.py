# RM3D, classes of points of three scans of SemanticKITTI's sequence 00, from 1 % of the points; measured on 01 and 99.
# Run: rm3d train rm3d_sem_semantickitti_few_1pct --cfg-options data_root=FOLDER [--demo]
# Time: not measured.
# Score on real scans: docs/RESULTS.md.
_base_ = './_base_/semantickitti_few.py'
budget = '1pct'
