# Sparse VoteNet for street scenes; sizes of the classes come from the annotated boxes at the start of a run.
model = dict(
    type='RM3DVoteNet',
    num_classes=3,
    heights=[-2.0, 1.0],
    backbone=dict(type='SparseUNet', voxel_size='${voxel_size}', widths='${widths}', blocks='${blocks}'),
    vote_head=dict(
        type='VoteHead',
        mean_sizes='${class_sizes}',
        heading_bins=12,
        num_seeds='${num_seeds}',
        num_proposals='${num_proposals}',
        hidden='${hidden}',
        radius=1.2,
        samples=32,
        near=[0.8, 0.4, 0.5],
        far=[1.6, 0.9, 1.1],
        unlabelled_weight='${unlabelled_weight}',
    ),
    losses='${losses}',
    fuse_iou=0.3,
)
# L_Det; a loss that is None is left out, and one of your own is a further entry.
losses = ['${vote_loss}', '${point_loss}', '${aug_loss}', '${dice_loss}', '${scene_class_loss}']
vote_loss = dict(type='VoteNetLoss', loss_weight=10.0)
point_loss = dict(
    type='WeakSupervision',
    balance='batch',
    power=0.25,
    loss=dict(type='PointCrossEntropyLoss', loss_weight=10.0, unlabelled_weight='${unlabelled_weight}'),
)
aug_loss = dict(type='ViewConsistency', loss=dict(type='JSAugLoss'))
dice_loss = dict(type='ProposalDice', loss=dict(type='DiceLoss'))
scene_class_loss = dict(type='SceneClasses', num_classes=3)
voxel_size = 0.1  # m
widths = [32, 64, 96, 128]
blocks = 2
num_seeds = 1024
num_proposals = 256
hidden = 128
class_sizes = [[3.9, 1.6, 1.56], [0.8, 0.6, 1.73], [1.76, 0.6, 1.73]]  # m, where no box of the class is annotated
unlabelled_weight = 0.1  # how far unknown points count as background; a few per cent of them are objects
