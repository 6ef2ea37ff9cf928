# Any folder of scans (docs/own_scans.md), outdoors, z up, metres; by default without labels of their own.
_base_ = './outdoor_pipeline.py'
dataset_type = 'FilesDataset'
data_root = 'data/scans'
class_names = ['ground', 'vegetation', 'building']
num_classes = 3  # as many as class_names
thing_classes = []
point_columns = ['shape']
columns = None  # which column plays which part, where names do not tell
label_map = None  # raw label -> class, where the scans have labels
other_labels = 'error'
intensity_range = None  # what the intensity is divided by
val_labels = 'store'  # the score tells how far the network agrees with its labels; 'truth' where the scans have labels
score_name = 'agreement'  # None with val_labels='truth'
reading = dict(
    classes='${class_names}',
    columns='${columns}',
    label_map='${label_map}',
    other_labels='${other_labels}',
    intensity_range='${intensity_range}',
    cache='${cache_dir}',
)
train_dataloader = dict(dataset=reading)
label_dataloader = dict(dataset=dict(pipeline='${eval_pipeline}', **reading))
val_dataloader = dict(
    dataset=dict(
        **reading,
        labels='${val_labels}',
        label_store='${work_dir}/labels',
        pipeline='${eval_pipeline}',
    )
)
del reading
val_evaluator = [dict(type='SemSegMetric', prefix='${score_name}')]
