"""The packager: a baseline that streams each viewer's camera as low-latency live DASH (CMAF)."""
