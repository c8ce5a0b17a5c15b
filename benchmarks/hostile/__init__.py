"""Whether one hostile address can spoil the service for a polite viewer: `python -m benchmarks.hostile`."""
