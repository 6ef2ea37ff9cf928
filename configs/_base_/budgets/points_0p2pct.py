# 0.2 % of the points, drawn by seed (METHOD 8).
budget = '0p2pct'
budget_seed = '${seed}'
