# A descriptor that learns the classes of labelled scans, all but the data: a sparse U-Net, and a linear layer for each data
# set that is dropped afterwards. Lengths in voxels, as wide as the density of a scan asks for.
_base_ = './pairs.py'
crop_points = 24000
keep = [0.35, 1.0]  # share of a crop's points that stay: crops differ in density
train_pipeline = [
    dict(type='RandomCrop', max_points='${crop_points}', shape='column', labelled=0.0),
    dict(type='RandomFlipY', prob=0.5),
    dict(type='GlobalRotScale', rot=[-3.1416, 3.1416], scale=[0.85, 1.15]),
    dict(type='PointNoise', jitter='${jitter}', columns=0.0),
    dict(type='RandomDownsample', keep='${keep}'),
    dict(type='ClassSites'),
    dict(type='PackScene'),
]
widths = [32, 48, 64]
model = dict(
    type='DescriptorNetwork',
    backbone='${backbone}',
    in_channels=44,  # of a site with histograms and heights
    channels='${channels}',
    losses=[dict(type='SiteClasses', channels='${channels}', classes='${site_classes}')],
)
demo = dict(crop_points=24000, batch_size=2, learning_rate=3e-3)
