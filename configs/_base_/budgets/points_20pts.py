# 20 labelled points a scene, drawn by seed (METHOD 8).
budget = '20pts'
budget_seed = '${seed}'
