"""Which effects a run simulates: evidence proposes, a short ablation confirms, the report says all of it."""
