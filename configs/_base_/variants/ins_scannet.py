# What all configs of instance segmentation on ScanNet share: offsets, masks of instances, their scores.
_base_ = './sem_scannet.py'
instance_head = '${point_group}'
offset_loss = dict(_delete_=True, type='InstanceOffsets', loss=dict(type='OffsetLoss', loss_weight='${offset_weight}'))
dice_loss = dict(_delete_=True, type='InstanceDice', loss=dict(type='DiceLoss', loss_weight='${dice_weight}'))
val_evaluator = [dict(type='SemSegMetric'), dict(type='InstanceSegMetric')]
demo = dict(cluster_radius=0.08, cluster_points=20, min_proposal_points=40)  # a point each 4 cm
