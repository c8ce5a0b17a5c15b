"""Capacity of a render service: viewers over HTTP/3 from several processes, and their frames."""
