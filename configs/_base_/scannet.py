# ScanNet v2, native layout: 20 classes, instances of all but wall and floor.
_base_ = './indoor.py'
dataset_type = 'ScanNetDataset'
data_root = 'data/scannet'
num_classes = 20
thing_classes = [2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19]
point_columns = ['rgb']
instance_metric = 'InstanceSegMetric'
demo = dict(demo_data=dict(scenes='scannet_rooms', num_train=72, num_val=16, seed=0))
