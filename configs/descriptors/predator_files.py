# Predator, from your own scans, without labels; no demo.
# Run: rm3d train predator_files --cfg-options data_root=FOLDER
# Time: not measured.
# Score on your scans: there is none without labels; `matched` in the log tells how many places are found again.
_base_ = '../_base_/predator.py'
data = 'files'
data_root = 'data/scans'
