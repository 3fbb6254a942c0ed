"""Studies of the engine: comparisons, what accuracy costs, stability. The engine imports nothing of them."""
