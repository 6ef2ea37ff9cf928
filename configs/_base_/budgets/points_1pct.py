# 1 % of the points, drawn by seed (METHOD 8).
budget = '1pct'
budget_seed = '${seed}'
