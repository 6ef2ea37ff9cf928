# 20 % of the points, drawn by seed (METHOD 8).
budget = '20pct'
budget_seed = '${seed}'
