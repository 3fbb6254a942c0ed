"""The medium's point spread from a photo of something known: a point of light, or a slanted edge."""
