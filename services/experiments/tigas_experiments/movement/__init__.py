"""How a viewer moves: traces, generated and recorded, and where they are in a scene (docs/experiments.md)."""
