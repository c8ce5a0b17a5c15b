"""The connection between the processes that talk to viewers (edges) and the one that renders (the engine)."""
