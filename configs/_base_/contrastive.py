# The paper's own descriptor: a sparse U-Net that learns from pairs of crops. Its losses: contrast = 'triplet' (L_TriC),
# 'pair' (L_C); 'hardest' is that of FCGF, 'nce' PointInfoNCE.
_base_ = './pairs.py'
contrast = 'nce'
num_pairs = 1024  # places of a batch that are compared
negative_distance = 16.0  # voxels, about 1 m in a room; METHOD 3
model = dict(
    type='DescriptorNetwork',
    backbone='${backbone}',
    in_channels=40,  # of a site with histograms
    channels='${channels}',
    direct=True,  # a site's own inputs count beside what the backbone makes of its surroundings
    losses=['${contrast_loss}'],
)
contrast_loss = dict(
    type='PairContrast', contrast='${contrast}', num_pairs='${num_pairs}', negative_distance='${negative_distance}'
)
