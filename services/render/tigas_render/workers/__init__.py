"""The render service as several processes: a supervisor, edges for the clients, and an engine for each device."""
