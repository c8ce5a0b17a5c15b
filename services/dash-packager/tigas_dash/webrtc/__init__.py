"""A viewer's stream over WebRTC, by aiortc, on one UDP port for all viewers."""
