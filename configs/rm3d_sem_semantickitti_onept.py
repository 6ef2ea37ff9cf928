# RM3D, classes of points of SemanticKITTI, from one labelled point per class and scene.
# Run: rm3d train rm3d_sem_semantickitti_onept [--demo]
# Time: not measured.
# Score on SemanticKITTI: not measured (the data set is not part of the repository). On the demo: docs/RESULTS.md.
_base_ = './_base_/semantickitti.py'
budget = 'onept'
# Clicks show all classes alike often, which they are not: with more of the loss rare classes are said everywhere.
annotated_share = 0.1
ground = dict(max_distance=3.0)  # m; they say nothing of ground further off
