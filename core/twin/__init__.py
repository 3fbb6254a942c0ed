"""A twin as a folder that lasts: opened, refined, updated with new photos, and rolled back."""
