"""The render service as several processes: a supervisor, edges that serve clients, and an engine for each device."""
