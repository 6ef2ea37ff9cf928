# Predator: the sparse U-Net with overlap attention; circle, overlap and saliency losses. Lengths in voxels.
_base_ = './pairs.py'
model = dict(
    type='PredatorNetwork',
    backbone='${backbone}',
    in_channels=40,  # of a site with histograms
    channels='${channels}',
    direct=True,  # a site's own inputs count beside what the backbone makes of its surroundings
    attention=dict(channels='${attention_channels}'),
    losses=[dict(type='PairCircle', num_pairs='${num_pairs}')],
)
attention_channels = 64  # 256 in the publication
num_pairs = 256  # places of a batch that are compared; METHOD 3
