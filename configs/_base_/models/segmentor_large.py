# Sparse U-Net segmentor, wide: m = 32, seven levels, two blocks, 2 cm voxels.
_base_ = ['./segmentor_paper.py']
widths = [32, 64, 96, 128, 160, 192, 224]
