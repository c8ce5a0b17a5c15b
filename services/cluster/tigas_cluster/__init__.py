"""Several render hosts that appear as one: who serves whom."""
