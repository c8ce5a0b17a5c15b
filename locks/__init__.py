"""What `make` and the images install, with digests; update.py writes it."""
