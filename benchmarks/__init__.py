"""What `make bench` and `make bench-gpu` run, and measurements that documents cite: `python -m benchmarks.NAME`."""
