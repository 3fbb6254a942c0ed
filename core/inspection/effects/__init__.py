"""One file per effect: `inspect(photos)` gives its `Evidence`."""
