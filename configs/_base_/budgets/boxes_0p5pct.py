# One labelled box per ten frames, drawn by seed (METHOD 8).
budget = '0p5pct'
budget_seed = '${seed}'
