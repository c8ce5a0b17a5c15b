"""What connects the processes that speak with viewers (edges) to the one that renders (the engine)."""
