"""Frames from requests: queues, render lanes and threads, and the encoder stage."""
