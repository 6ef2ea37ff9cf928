# SemanticKITTI, native layout: 19 classes, one scan a scene; sequence 08 is the validation split.
_base_ = './outdoor.py'
dataset_type = 'SemanticKittiDataset'
data_root = 'data/semantickitti'
num_classes = 19
thing_classes = [0, 1, 2, 3, 4, 5, 6, 7]
point_columns = ['intensity', 'shape']
use_intensity = True  # False (with point_columns=['shape']) where some scans have none
train_sequences = None  # None: those of the split
val_sequences = None
train_every = 1  # of the training scans, each so many-th
train_dataloader = dict(
    dataset=dict(sequences='${train_sequences}', use_intensity='${use_intensity}', every='${train_every}')
)
label_dataloader = dict(
    dataset=dict(sequences='${train_sequences}', use_intensity='${use_intensity}', every='${train_every}')
)
val_dataloader = dict(dataset=dict(sequences='${val_sequences}', use_intensity='${use_intensity}'))
confidence_power = 1.0  # many classes are rare, and their labels often wrong
region_prior = dict(heading=True)  # a vehicle's scans
ground = dict(classifier='kernel', heading=True)
# The last labels are the best: they teach for two thirds of the training.
demo = dict(
    demo_data=dict(scenes='semantickitti_streets', num_train=64, num_val=14, seed=0),
    rounds=6,
    sigma=3,
    final_rounds=4,
    val_rounds=6,
)
