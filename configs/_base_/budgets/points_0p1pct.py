# 0.1 % of the points, drawn by seed (METHOD 8).
budget = '0p1pct'
budget_seed = '${seed}'
