"""Experiments: runs of the viewer over a known network, with their records, statistics and reports."""
