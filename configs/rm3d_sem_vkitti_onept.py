# RM3D semantic segmentation of vKITTI 3D from one labelled point per class and scene.
# Run: python tools/train.py configs/rm3d_sem_vkitti_onept.py [--demo]
# Score on vKITTI 3D: not measured (the data set is not part of the repository). Demo scores: docs/RESULTS.md.
_base_ = ['./_base_/variants/sem_vkitti.py', './_base_/budgets/points_onept.py']
ground_reach = 3.0  # m; of use with --demo
# Clicks show all classes alike often, which they are not: with more of the loss rare classes are said everywhere.
demo = dict(annotated_share=0.1)
