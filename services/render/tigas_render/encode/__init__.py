"""Codecs for images in host memory."""
