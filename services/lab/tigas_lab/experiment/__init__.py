"""Experiments: a matrix of runs, made one after the other, which go on where they were interrupted."""
