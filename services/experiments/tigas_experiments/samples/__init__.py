"""Samples of a run, rendered again afterwards: the same frame, and the same view losslessly."""
