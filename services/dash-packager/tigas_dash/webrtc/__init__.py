"""Streams over WebRTC with aiortc, on a single UDP port for all viewers."""
