"""What both tasks share: annotated labels, groups of regions, ledgers."""
