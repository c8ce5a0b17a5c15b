"""The pipe between the processes that serve viewers (edges) and a process that renders (an engine)."""
