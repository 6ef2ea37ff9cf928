# S3DIS, native layout: 13 classes, all with instances; Area 5 is the test area by default.
_base_ = './indoor.py'
dataset_type = 'S3DISDataset'
data_root = 'data/s3dis'
test_area = 5
val_split = 'test'
num_classes = 13
thing_classes = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]
point_columns = ['rgb']
instance_metric = 'S3DISInstanceMetric'
train_dataloader = dict(dataset=dict(test_area='${test_area}'))
label_dataloader = dict(dataset=dict(test_area='${test_area}'))
val_dataloader = dict(dataset=dict(test_area='${test_area}'))
demo = dict(demo_data=dict(scenes='s3dis_rooms', rooms_per_area=5, seed=0))
