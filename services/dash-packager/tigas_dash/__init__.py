"""The packager: a low-latency DASH (CMAF) live stream of each viewer's camera, as a baseline."""
