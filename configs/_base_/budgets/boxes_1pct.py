# Two labelled boxes per ten frames, drawn by seed (METHOD 8).
budget = '1pct'
budget_seed = '${seed}'
