"""The packager: a low-latency DASH (CMAF) live stream of what each viewer's camera sees, to compare with."""
