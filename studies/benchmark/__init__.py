"""The benchmark: scenes of many kinds, split once into chosen on and checked on, each run as a user runs it."""
