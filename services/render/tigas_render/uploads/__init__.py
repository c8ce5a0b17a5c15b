"""Uploads of scene files from pages, in parts."""
