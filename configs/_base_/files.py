# Your own scans (docs/own_scans.md), z up, metres, from what a person clicked; by default without labels. No demo.
_base_ = './outdoor.py'
dataset_type = 'FilesDataset'
data_root = 'data/scans'
scan_list = None  # file with the name of a scan in each line; None: all scans of data_root
class_names = ['ground', 'vegetation', 'building']
num_classes = None  # as many as class_names
thing_classes = []
columns = None  # which column plays which part, where names do not tell
label_map = None  # raw label -> class, where the scans have labels
other_labels = 'error'
intensity_range = None  # [least, greatest], which become 0 and 1; None: found from the scans
val_labels = 'store'  # nothing is scored, the labels are estimated from clicks; 'truth' where the scans have labels
reading = dict(
    ann_file='${scan_list}',
    classes='${class_names}',
    columns='${columns}',
    label_map='${label_map}',
    other_labels='${other_labels}',
    intensity_range='${intensity_range}',
    cache='${cache_dir}',
)
train_dataloader = dict(dataset=reading)
label_dataloader = dict(dataset=reading)
val_dataloader = dict(dataset=dict(**reading, labels='${val_labels}', label_store='${work_dir}/labels'))
del reading
val_evaluator = [dict(type='SemSegMetric', labels='${val_labels}')]
# Labels propagate within one scan (or a few): a step sees it whole, and the network is told where in it a point lies, since it
# is this very scan that is asked for and near points are often alike. `place` stands for a point whatever way the scan is turned.
crop_points = 1000000  # larger scans are learnt and predicted in parts
model = dict(inference=dict(max_points='${crop_points}'))
point_columns = None  # what all scans have of intensity and colour, found from them, then 'shape' and 'place'
train_pipeline = [
    dict(type='ColorJitter'),
    dict(type='ShapeFeatures', cache='${cache_dir}'),
    dict(type='SinusoidalPosition'),
    dict(type='HeightAboveGround'),
    dict(type='ClassCrop', max_points='${crop_points}'),
    dict(type='GlobalRotScale', rot=[-3.1416, 3.1416], scale=[0.9, 1.1]),
    dict(type='RandomFlipY', prob=0.5),
    '${method_view}',
    dict(type='PackScene'),
]
eval_pipeline = [
    dict(type='ShapeFeatures', cache='${cache_dir}'),
    dict(type='SinusoidalPosition'),
    dict(type='HeightAboveGround'),
    dict(type='PackScene'),
]
voxel_size = 0.4  # m
widths = [16, 32, 48, 64, 80]
blocks = 1
annotated_share = None
ground_cell = 1.5  # m
zeta = 0.02
oversegmenter = dict(rest=dict(min_region=40))
propagation = dict(max_extent=None)
region_prior = dict(gamma=0.75)
ground = None
walker = dict()  # labels spread by a random walk: walker.accept=.7 for purer ones
# strategy=regions: regions merge by the rules above
random_walk = dict()
label_maker = dict(walker='${walker}', random_walk='${random_walk}')
# Two refreshes of the labels; that in the middle of the second period does not disturb it. A step is a scan: a single scan
# needs 80 epochs a round for the network to know what its labels say. Many scans have as many times the steps; fewer epochs
# of them (sigma=20 periods=[20,40], say) were not measured.
rounds = 3
sigma = 80
param_scheduler = '${restart_schedule}'
periods = [80, 160]
restart_weights = [1, 0.8]
batch_size = 1
learning_rate = 1e-2
val_rounds = 3
checkpoint_interval = '${sigma}'
demo = None
