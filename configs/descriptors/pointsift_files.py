# Point-SIFT, from your own scans, without labels; no demo.
# Run: rm3d train pointsift_files --cfg-options data_root=FOLDER
# Time: not measured.
# Score on your scans: there is none without labels; `matched` in the log tells how many places are found again.
_base_ = '../_base_/pointsift.py'
data = 'files'
data_root = 'data/scans'
