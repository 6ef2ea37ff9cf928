# One labelled point per class and scene, drawn by seed (METHOD 8).
budget = 'onept'
budget_seed = '${seed}'
