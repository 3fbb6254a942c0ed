"""One module for each device that a twin can be computed on; `core.devices` says what it must offer."""
