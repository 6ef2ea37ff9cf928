# RM3D semantic segmentation of Semantic3D from 20 labelled points a scene.
# Run: python tools/train.py configs/rm3d_sem_semantic3d_20pts.py [--demo]
# Score on Semantic3D: not measured (the data set is not part of the repository). Demo scores: docs/RESULTS.md.
_base_ = ['./_base_/variants/sem_semantic3d.py', './_base_/budgets/points_20pts.py']
ground_reach = 3.0  # m; of use with --demo
# So few labelled points say little: with more of the loss they make it noisy.
demo = dict(annotated_share=0.1)
