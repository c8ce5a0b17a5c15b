"""Comparison of shown pictures with ground truth."""
