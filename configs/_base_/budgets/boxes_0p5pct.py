# One labelled box per ten frames, as many of each class as of another while there are any, drawn by seed (METHOD 8).
budget = dict(per_scene=0.1, alike=True)  # '0p5pct': classes as they come
budget_seed = '${seed}'
