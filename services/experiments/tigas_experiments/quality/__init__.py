"""Shown pictures against ground truth."""
