"""Experiments: runs of the viewer over a network that is known, their records, statistics and reports."""
