# Point-SIFT: orientation encoding at several scales, the loss of the paper's own descriptor. Lengths in voxels.
_base_ = './pairs.py'
radii = [2.0, 4.0, 8.0]  # of the units, one behind the other; METHOD 3 has .1, .25 and .5 m
num_pairs = 1024  # places of a batch that are compared
contrast = 'nce'  # or 'triplet', 'pair', 'hardest'
negative_distance = 16.0  # about 1 m in a room; METHOD 3
contrast_loss = dict(
    type='PairContrast', contrast='${contrast}', num_pairs='${num_pairs}', negative_distance='${negative_distance}'
)
model = dict(
    type='DescriptorNetwork',
    backbone=dict(type='PointSIFTBackbone', channels='${channels}', radii='${radii}'),
    in_channels=40,  # of a site with histograms
    channels='${channels}',
    losses=['${contrast_loss}'],
)
