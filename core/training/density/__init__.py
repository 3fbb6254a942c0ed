"""How many Gaussians there are, where, and how fine: they begin, split, and go."""
