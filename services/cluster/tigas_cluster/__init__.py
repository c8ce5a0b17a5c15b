"""Several render hosts behind one address, and the assignment of viewers to hosts."""
