"""Codecs for images in host memory: one module each."""
