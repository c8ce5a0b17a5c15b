"""Commands that make and score runs: `tigas experiment`, `tigas paper` and `tigas quality`."""
