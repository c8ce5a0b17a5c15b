"""Samples of a run, rendered again after it: the same frame, and the same view without loss."""
