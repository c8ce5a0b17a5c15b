"""The engine, which turns requests into frames: queues, render lanes and threads, and the encoder stage."""
