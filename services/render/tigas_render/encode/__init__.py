"""Codecs for images in the host's memory: one module each."""
