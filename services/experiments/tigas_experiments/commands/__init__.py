"""The commands that make runs and end with a report: `tigas experiment` and `tigas compare`."""
