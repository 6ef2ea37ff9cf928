# S3DIS, native layout: 13 classes, Area 5 is the test area by default.
_base_ = './indoor_pipeline.py'
dataset_type = 'S3DISDataset'
data_root = 'data/s3dis'
test_area = 5
val_split = 'test'
num_classes = 13
thing_classes = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]
point_columns = ['rgb']
train_dataloader = dict(dataset=dict(test_area='${test_area}'))
label_dataloader = dict(dataset=dict(test_area='${test_area}'))
val_dataloader = dict(dataset=dict(test_area='${test_area}'))
