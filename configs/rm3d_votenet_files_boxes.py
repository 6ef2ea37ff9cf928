# RM3D, boxes of your own scans, from the boxes that there are: docs/own_boxes.md.
# Run: rm3d train rm3d_votenet_files_boxes --cfg-options data_root=FOLDER
# Time: not measured.
# Score on harbour scans: not measured.
_base_ = './_base_/box_files.py'
budget = 'full'  # every box that is there; 'scenes10pct', 'onebox': fewer, to try
