# vKITTI 3D, native .npy frames: 13 classes; fold 6 is the test fold by default.
_base_ = './outdoor.py'
dataset_type = 'VKITTI3DDataset'
data_root = 'data/vkitti3d'
test_fold = 6
val_split = 'test'
num_classes = 13
thing_classes = []
point_columns = ['rgb', 'shape']
train_dataloader = dict(dataset=dict(test_fold='${test_fold}'))
label_dataloader = dict(dataset=dict(test_fold='${test_fold}'))
val_dataloader = dict(dataset=dict(test_fold='${test_fold}'))
demo = dict(demo_data=dict(scenes='vkitti_streets', num_train=16, num_val=14, seed=0))
