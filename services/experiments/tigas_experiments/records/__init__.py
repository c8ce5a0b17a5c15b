"""Records of runs: configuration, recording, and the resulting figures."""
