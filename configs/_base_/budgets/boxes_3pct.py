# 3 % of the boxes, drawn by seed (METHOD 8).
budget = '3pct'
budget_seed = '${seed}'
