"""How many viewers a render service serves: viewers over HTTP/3 from several processes, and what they met."""
