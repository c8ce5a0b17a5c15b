"""The render service as several processes: edges, which speak with clients, and the engine, which renders."""
