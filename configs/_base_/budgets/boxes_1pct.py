# Two boxes per ten scenes, drawn by seed (METHOD 8); other budgets: '0p5pct', '3pct', 'full'.
budget = '1pct'
budget_seed = '${seed}'
