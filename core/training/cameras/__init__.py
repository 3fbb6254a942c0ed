"""The cameras, adjusted to the twin while it is trained."""
