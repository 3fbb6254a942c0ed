"""What descattering is worth: several ways to a twin from the same blurred photos, scored against the truth.

A data set (`dataset`) goes through every method (`methods`) with the same optimizer, budget, seeds and
held-out views (`runs`); each twin is measured (`measure`) and the rows become a table and pictures.
"""
