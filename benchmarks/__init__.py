"""Benchmarks of `make bench` and `make bench-gpu`, and measurements cited by documents: `python -m benchmarks.NAME`."""
