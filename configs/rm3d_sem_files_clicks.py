# RM3D semantic segmentation of a scan of one's own from clicks: docs/own_scans.md.
# Run: python tools/train.py configs/rm3d_sem_files_clicks.py --cfg-options data_root=FOLDER budget.clicks=clicks.csv \
#          'class_names=[ground,tree,car]' num_classes=3
# Score on single real scans: docs/RESULTS.md.
_base_ = ['./_base_/variants/sem_files.py']
budget = dict(clicks='clicks.csv')
budget_seed = '${seed}'
