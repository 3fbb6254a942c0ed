"""The medium's point spread from a photo of a simple thing: a point of light, or a slanted edge."""
