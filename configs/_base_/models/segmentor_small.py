# Sparse U-Net segmentor for a CPU: four levels, coarse voxels, thinned points.
_base_ = ['./segmentor_paper.py']
voxel_size = 0.05  # m
widths = [16, 32, 48, 64]
blocks = 1
cluster_radius = 0.08  # m; thinned points lie further apart than those of a full scan
cluster_points = 20
min_proposal_points = 40
