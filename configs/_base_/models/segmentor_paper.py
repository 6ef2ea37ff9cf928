# Sparse U-Net segmentor of the paper: m = 16, seven levels, two blocks, 2 cm voxels.
# num_classes, thing_classes (class numbers that have instances) and point_columns (['intensity'], ['rgb'], ...) come from
# the data set. A leaf for instances says instance_head = '${point_group}'.
model = dict(
    type='RM3DSegmentor',
    num_classes='${num_classes}',
    inputs=dict(columns='${point_columns}', use='${use_columns}', coordinates='${use_coordinates}'),
    backbone=dict(type='SparseUNet', voxel_size='${voxel_size}', widths='${widths}', blocks='${blocks}'),
    semantic_head=dict(type='SemanticHead'),
    instance_head='${instance_head}',
    losses='${losses}',
    thing_classes='${thing_classes}',
    inference=dict(
        first_angle='${first_angle}',
        tta_rotations='${votes}',
        superpoint_smoothing='${superpoint_smoothing}',
        logit_adjustment='${logit_adjustment}',
    ),
)
voxel_size = 0.02  # m
widths = [16, 32, 48, 64, 80, 96, 112]
blocks = 2
votes = 1  # directions from which a scene is predicted
superpoint_smoothing = (
    0.0  # of a point's probabilities that is its region's mean; above 0 eval_pipeline needs RegionNumbers
)
logit_adjustment = 0.0  # of the classes' annotated labels, at test time; larger: rare classes are said more rarely
first_angle = 0.0  # degrees by which a scene is turned before it is predicted
use_coordinates = False  # True: the place in the scene too; crops then differ from whole scenes
use_columns = '${point_columns}'  # []: a network that sees shapes only

# L_Seg; variants/ins_*.py add those of instances. A loss that is None is left out, and one of your own is a further entry.
losses = ['${point_loss}', '${aug_loss}', '${offset_loss}', '${dice_loss}']
point_loss = dict(
    type='WeakSupervision',
    balance='${class_balance}',
    power='${class_power}',
    pseudo_weight='${pseudo_weight}',
    annotated_share='${annotated_share}',
)
class_balance = 'none'  # 'frequency': by the annotated labels; 'batch': by the labels of a batch
class_power = 0.5  # weight of a class = labels of it ^ -0.5
pseudo_weight = 1.0  # of a label that the budget did not show
annotated_share = None  # of L_WSL that annotated labels have, however few; None: all labels alike
aug_loss = dict(type='ViewConsistency', loss=dict(type='JSAugLoss'))
aug_prob = 1.0  # share of scenes with a second view for that loss; smaller: faster
offset_loss = None
dice_loss = None
offset_weight = 1.0  # of the offsets' loss, with instances; smaller: classes are learnt faster
dice_weight = 1.0  # of the masks' loss

instance_head = None
point_group = dict(
    type='PointGroupHead',
    proposals=dict(
        radius='${cluster_radius}',
        cluster_points='${cluster_points}',
        min_points='${min_proposal_points}',
        nms_iou=0.3,
        coordinates='both',
    ),
)
cluster_radius = 0.03  # m
cluster_points = 50
min_proposal_points = 100
