# All points, drawn by seed (METHOD 8).
budget = 'full'
budget_seed = '${seed}'
