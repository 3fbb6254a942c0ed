"""Hard cases: what breaks splatting engines elsewhere, each measured on this machine.

A case is a small function that returns an error; it holds where that error stays within its
tolerance. `run_dgs.py stress` runs them all, the tests run them one by one.
"""
