"""Slow, readable counterparts of production code, shared by tests and benchmarks and not part of the wheel."""
