"""The commands that make runs and write a report: `tigas experiment` and `tigas compare`."""
