"""Network traces: the capacity of a link over time, and sources of such traces, independent of any link."""
